"""How sure one can be: bounds on a probability from counts."""

from __future__ import annotations

from math import exp, lgamma, log, log1p


def upper_bound(events: int, trials: int, confidence: float = 0.95) -> float:
    """One-sided Clopper-Pearson upper bound on a probability.

    With `confidence`, the probability of which `events` of `trials` independent ones are a sample
    is below it. For no event: 1 - (1 - confidence)^(1 / trials). 1 for no trials.

    Raises:
        ValueError: unless 0 <= events <= trials and 0 < confidence < 1.
    """
    if not 0 <= events <= trials or not 0.0 < confidence < 1.0:
        raise ValueError(f"{events} events of {trials} trials, confidence {confidence}")
    if events == trials:
        return 1.0
    if events == 0:
        return float(1.0 - (1.0 - confidence) ** (1.0 / trials))
    low, high = events / trials, 1.0
    for _ in range(100):
        middle = (low + high) / 2
        if _at_most(events, trials, middle) > 1.0 - confidence:
            low = middle
        else:
            high = middle
    return high


def _at_most(events: int, trials: int, p: float) -> float:
    """P(X <= events) for X binomial with `trials` and 0 < p < 1."""
    if p >= 1.0:
        return 0.0
    total = 0.0
    for i in range(events + 1):
        ways = lgamma(trials + 1) - lgamma(i + 1) - lgamma(trials - i + 1)
        total += exp(ways + i * log(p) + (trials - i) * log1p(-p))
    return total
