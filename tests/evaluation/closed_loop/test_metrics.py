"""The metrics on episodes counted by hand."""

import math

import numpy as np
import pytest

from sandra.evaluation.closed_loop import OURS, PAPER, Metrics, Proofs, measure, summarise, wilson
from sandra.simulation.policies import Run


def run(steps=30, crash=None, fail_safe=(), lane=None, seed=1):
    """An episode at 10 m/s; `crash` and `fail_safe` are numbers of steps, from 1 on."""
    steps = steps if crash is None else crash
    crashed = np.arange(steps + 1) >= (crash or steps + 1)
    flags = np.isin(np.arange(1, steps + 1), list(fail_safe))
    return Run(
        driver="test",
        seed=seed,
        setting=1,
        profile="stock",
        dt=0.2,
        x=100 + 2.0 * np.arange(steps + 1),
        speed=np.full(steps + 1, 10.0),
        lane=np.zeros(steps + 1, dtype=int) if lane is None else np.asarray(lane),
        crashed=crashed,
        traffic_speed=np.full(steps + 1, 12.0),
        actions=("IDLE",) * steps,
        fail_safe=flags,
    )


def test_a_full_episode():
    assert measure(run()) == Metrics(
        success=True,
        collision_free_steps=30,
        compliant_steps={},
        success_steps=30,
        distance=60.0,
        fail_safe_rate=0.0,
        relative_speed=-2.0,
        lane_changes=0,
        steps=30,
    )


@pytest.mark.parametrize(
    ("crash", "ours", "papers"),
    [
        (1, False, False),
        (29, False, False),
        (30, False, True),
        (31, True, True),
        (None, True, True),
    ],
)
def test_which_collisions_count(crash, ours, papers):
    episode = run(steps=31, crash=crash)
    assert measure(episode, convention=OURS).success is ours
    assert measure(episode, convention=PAPER).success is papers


def test_until_the_collision():
    metrics = measure(run(crash=8))
    assert metrics.collision_free_steps == 7
    assert metrics.distance == 16.0
    assert metrics.steps == 8


def test_an_episode_cut_short_is_no_success():
    assert not measure(run(steps=29)).success


def test_rules_and_what_a_fail_safe_justifies():
    rules = ("R_G1", "R_G2")
    compliance = np.ones((30, 2), dtype=bool)
    compliance[3, 0] = False  # step 4: too close
    compliance[[5, 6], 1] = False  # steps 6 and 7: abrupt braking, 6 as a fail-safe
    metrics = measure(run(fail_safe=[4, 6]), compliance, rules)
    assert metrics.compliant_steps == {"R_G1": 29, "R_G2": 28}
    assert metrics.success_steps == 28  # not 4 (R_G1 is never justified), not 7
    assert metrics.fail_safe_rate == pytest.approx(2 / 30)
    crashed = measure(run(crash=8, fail_safe=[8]), compliance, rules)
    assert crashed.compliant_steps == {"R_G1": 6, "R_G2": 5}
    assert crashed.success_steps == 4  # of seven not 4, 6, 7: this time 6 was no fail-safe


def test_compliance_must_fit():
    with pytest.raises(ValueError, match="shape"):
        measure(run(), np.ones((29, 1), dtype=bool), ("R_G1",))
    with pytest.raises(ValueError, match="shape"):
        measure(run(), np.ones((30, 2), dtype=bool), ("R_G1",))


def test_lane_changes_are_counted_at_the_centre():
    lanes = [0] * 10 + [1] * 5 + [2] * 8 + [1] * 8
    assert measure(run(lane=lanes)).lane_changes == 3


def test_a_row():
    metrics = [(1, measure(run())), (2, measure(run(crash=10))), (2, measure(run(fail_safe=[1])))]
    row = summarise(metrics)
    assert (row.episodes, row.seeds, row.successes) == (3, 2, 2)
    assert row.success_rate == pytest.approx(2 / 3)
    assert row.success_interval == wilson(4 / 3, 2)
    assert row.distance == 60.0
    assert row.distance_all == pytest.approx((60 + 20 + 60) / 3)
    assert row.fail_safe_rate == pytest.approx(1 / 70)
    assert row.collision_free_steps == pytest.approx((30 + 9 + 30) / 3)
    assert math.isnan(summarise([(2, measure(run(crash=3)))]).distance)


def test_a_row_with_proofs():
    one = Proofs(None, 2, 1, True, {"certified": 27, "carried": 3}, 0.1, 0.2)
    two = Proofs(True, 0, 0, False, {"certified": 5, "emergency": 5}, 0.3, 0.5)
    three = Proofs(False, 4, 0, False, {"emergency": 10}, 0.2, 0.3)
    row = summarise([(seed, measure(run(seed=seed))) for seed in (1, 2, 3)], [one, two, three])
    assert (row.at_fault, row.not_at_fault, row.certified_starts) == (1, 1, 1)
    assert (row.uncovered, row.unexplained) == (6, 1)
    assert row.operations == {"certified": 0.64, "carried": 0.06, "emergency": 0.3}
    assert row.cpu == pytest.approx(0.2)
    assert row.cpu_max == 0.5
    assert summarise([(1, measure(run()))]).at_fault is None


def test_wilson_against_its_definition():
    """The bounds are the rates from which the observed one is z standard deviations away."""
    for k, n in ((1, 10), (5, 10), (29, 30), (3.5, 10)):
        for bound in wilson(k, n):
            assert abs(k / n - bound) == pytest.approx(
                1.959964 * math.sqrt(bound * (1 - bound) / n), rel=1e-9
            )
    assert wilson(10, 10) == (pytest.approx(0.7224672), 1.0)
    assert wilson(0, 10) == (0.0, pytest.approx(1 - 0.7224672))
    with pytest.raises(ValueError, match="no rate"):
        wilson(3, 2)
