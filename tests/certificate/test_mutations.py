"""Certificates with one thing changed: each is rejected, with the right condition."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from certificate.changes import BASE, BENT, HARD, MUTATIONS, Mutation, settings
from certified import HORIZON, constant, made, turning_scene
from sandra.certificate import CONDITIONS, check
from sandra.certificate.motion import highest_lateral
from sandra.settings import Settings


def test_there_are_enough_kinds_of_mutations() -> None:
    assert len(MUTATIONS) >= 30
    for certificate in (BASE, BENT, HARD):
        assert check(certificate).accepted, str(check(certificate))


@pytest.mark.parametrize("name", MUTATIONS)
def test_a_changed_certificate_is_rejected_for_the_right_reason(name: str) -> None:
    condition, mutate = MUTATIONS[name]
    report = check(mutate(BASE))
    assert not report.accepted
    assert report.violation is not None
    assert report.violation.condition == condition, str(report)
    assert report.violation.sentence
    order = list(CONDITIONS)
    assert [x.condition for x in report.checked] == order[: order.index(condition)]


@pytest.mark.parametrize(
    ("name", "mutate"),
    [
        ("steering-angle", settings(steering_angle_max=float(BENT.initial[4]) / 1.01)),
        ("motion", lambda c: replace(c, ego=replace(c.ego, wheelbase=2.7))),
        ("lateral-acceleration", settings(a_lat_max=2.0 / 1.01)),
    ],
)
def test_a_changed_certificate_on_a_bent_road_is_rejected(name: str, mutate: Mutation) -> None:
    report = check(mutate(BENT))
    assert report.violation is not None
    assert report.violation.condition == name, str(report)


def test_a_bound_that_is_just_kept_is_accepted() -> None:
    tight = Settings(
        a_lon_min=-5.0,
        a_lon_max=0.0,
        v_max=10.0,
        a_lat_max=2.0,
        steering_angle_max=float(BENT.initial[4]),
    )
    assert check(replace(BENT, settings=tight)).accepted


def test_a_limit_between_grid_points_counts() -> None:
    """Braking while steering back and forth: the peak lies within a step."""
    scene = turning_scene(0.02, others=False)
    peak = np.vstack([constant(0.0, 20), constant(0.0, 1, 0.2), constant(0.0, 1, -0.2)])
    rest = constant(0.0, 2 * HORIZON - len(peak))
    c = made(scene, inputs=np.vstack([peak, rest]))
    most = float(highest_lateral(c.witness, 2.6).max())
    assert most > 2.05
    assert check(replace(c, settings=c.settings.replace(a_lat_max=most))).accepted
    refused = check(replace(c, settings=c.settings.replace(a_lat_max=most / 1.01)))
    assert refused.violation is not None
    assert refused.violation.condition == "lateral-acceleration"
