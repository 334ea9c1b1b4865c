"""The Clopper-Pearson bound: its closed form, its definition, and its coverage."""

from __future__ import annotations

import numpy as np
import pytest

from sandra.evaluation.rollouts.statistics import upper_bound


def test_no_event() -> None:
    assert upper_bound(0, 10_000) == pytest.approx(1 - 0.05**1e-4)
    assert upper_bound(0, 10_000) == pytest.approx(3.0e-4, rel=0.01)
    assert upper_bound(0, 0) == 1.0
    assert upper_bound(5, 5) == 1.0


@pytest.mark.parametrize(("events", "trials"), [(1, 10), (3, 100), (17, 40), (2, 10_000)])
def test_at_the_bound_so_few_events_have_five_per_cent(events: int, trials: int) -> None:
    from scipy.stats import beta, binom

    bound = upper_bound(events, trials)
    assert binom.cdf(events, trials, bound) == pytest.approx(0.05, rel=1e-6)
    assert bound == pytest.approx(beta.ppf(0.95, events + 1, trials - events), rel=1e-6)


def test_it_holds_at_least_as_often_as_it_says() -> None:
    rng = np.random.default_rng(0)
    counts = rng.binomial(50, 0.1, 2000)
    held = np.mean([upper_bound(int(k), 50) >= 0.1 for k in counts])
    assert held >= 0.945


def test_nonsense_is_refused() -> None:
    for events, trials in ((-1, 3), (4, 3)):
        with pytest.raises(ValueError, match="events of"):
            upper_bound(events, trials)
