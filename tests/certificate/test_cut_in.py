"""Condition `cut-in`, against every legal cut-in and full braking after it, played out."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from certified import TAU, constant, made
from sandra.certificate import Certificate, Violation, check
from sandra.certificate.cut_in import cut_in


def relying(c: Certificate) -> Certificate:
    """The same, as if its set-based prediction relied on legal cut-ins."""
    others = tuple(replace(o, assumptions=(*o.assumptions, "legal_cut_in")) for o in c.obstacles)
    return replace(c, obstacles=others)


def driven(c: Certificate) -> np.ndarray:
    """Speeds at all grid points from 0 to the standstill."""
    until = round(c.t_dec / c.witness.tau)
    return np.concatenate([c.witness.states[:until, 3], c.fail_safe.states[:, 3]])


def least_gap(v: np.ndarray, c: Certificate) -> float:
    """The smallest gap to anyone who cuts in legally at a grid point and brakes with a_obs_min."""
    s = c.settings
    front = np.concatenate([[0.0], np.cumsum((v[1:] + v[:-1]) / 2 * TAU)])
    least = np.inf
    for k in range(len(v)):
        later = np.arange(len(v) - k) * TAU
        for theirs in np.linspace(0.0, 40.0, 41):
            gap = v[k] ** 2 / (2 * -s.a_min) - theirs**2 / (2 * -s.a_obs_min) + v[k] * s.t_d
            until = np.minimum(later, theirs / -s.a_obs_min)
            rear = front[k] + max(gap, 0.0) + theirs * until + s.a_obs_min / 2 * until**2
            least = min(least, float((rear - front[k:]).min()))
    return least


def test_mild_braking_is_refused_only_where_it_is_relied_on() -> None:
    mild = made(stop=constant(-2.0, 100), rules=())
    assert check(mild).accepted
    refused = check(relying(mild)).violation
    assert refused is not None
    assert refused.condition == "cut-in"
    assert refused.measured is not None
    assert refused.allowed is not None
    # 1 m until the decision and 25 m of braking, against 100 / 12 + 4 m.
    assert refused.measured == pytest.approx(26.0, abs=0.01)
    assert refused.allowed == pytest.approx(100 / 12 + 4.0, abs=0.01)
    assert check(relying(made(rules=()))).accepted


def test_it_agrees_with_what_is_played_out() -> None:
    rng = np.random.default_rng(2)
    seen = set()
    for _ in range(40):
        braking = rng.choice([1.0, 2.0, 2.5, 4.0, 5.0])
        wait = int(rng.integers(0, 12))
        stop = np.vstack([constant(0.0, wait), constant(-braking, round(10 / braking / TAU))])
        c = relying(made(stop=stop, rules=()))
        answer = cut_in(c)
        gap = least_gap(driven(c), c)
        if isinstance(answer, Violation):
            assert gap < 1e-6
        else:
            assert gap >= -1e-3
        seen.add(type(answer))
    assert len(seen) == 2


def test_the_slack_may_be_used_in_full(monkeypatch: pytest.MonkeyPatch) -> None:
    c = relying(made(stop=constant(-2.0, 100), rules=()))
    found = cut_in(c)
    assert isinstance(found, Violation)
    assert found.measured is not None
    assert found.allowed is not None
    missing = found.measured - found.allowed
    # The same subtraction that the condition makes, so the same number to the last bit.
    monkeypatch.setattr("sandra.certificate.cut_in.SLACK", missing)
    assert not isinstance(cut_in(c), Violation)
    monkeypatch.setattr("sandra.certificate.cut_in.SLACK", np.nextafter(missing, 0.0))
    assert isinstance(cut_in(c), Violation)


def test_the_violation_says_when_and_who() -> None:
    c = made(inputs=constant(-2.0, 30), stop=constant(-2.0, 98), rules=())
    found = cut_in(relying(c))
    assert isinstance(found, Violation)
    assert found.step is not None
    assert found.time == pytest.approx(found.step * TAU)
    assert f"{found.measured:.2f} m" in found.sentence
    assert f"like obstacle {c.obstacles[0].id}, need only leave {found.allowed:.2f} m" in (
        found.sentence
    )
    later = made(stop=np.vstack([constant(-6.0, 10), constant(-1.0, 140)]), rules=())
    late = cut_in(relying(later))
    assert isinstance(late, Violation)
    assert late.step is not None
    assert late.step > 0
    assert late.time == pytest.approx(late.step * TAU)
