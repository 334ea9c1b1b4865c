"""What is better: weights that are refused, commands, and each term of the cost by hand."""

from dataclasses import replace
from math import inf, nan

import numpy as np
import pytest

from sandra.errors import SettingsError
from sandra.planning.cost import Course, Weights, clearance_cost, costs

TERMS = ("jerk", "lateral", "centre", "speed", "change", "clearance")
NOTHING = Weights(jerk=0.0, lateral=0.0, centre=0.0, speed=0.0, change=0.0, clearance=0.0)


@pytest.mark.parametrize("name", TERMS)
def test_weights_are_finite_and_not_negative(name: str) -> None:
    assert getattr(Weights(**{name: 0.0}), name) == 0.0  # a term may be switched off
    for value in (-1e-9, inf, nan, -inf):
        with pytest.raises(SettingsError, match=f"weight {name} = "):
            Weights(**{name: value})


def test_the_desired_speed_is_finite_and_not_negative() -> None:
    assert Weights(desired_speed=0.0).desired_speed == 0.0
    assert Weights().desired_speed is None
    for value in (-1e-9, inf, nan):
        with pytest.raises(SettingsError, match="desired speed"):
            Weights(desired_speed=value)


def test_faster_may_be_slower_but_is_finite() -> None:
    assert Weights(faster=-3.0).faster == -3.0
    for value in (inf, -inf, nan):
        with pytest.raises(SettingsError, match="faster"):
            Weights(faster=value)


PLAIN = Weights()
FASTER = replace(PLAIN, speed=3.0, jerk=0.5, faster=5.0)
SLOWER = replace(PLAIN, speed=2.0, faster=-5.0)
COMFORT = replace(PLAIN, jerk=4.0, lateral=4.0)
APART = replace(PLAIN, clearance=8.0)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        (None, PLAIN),
        ("", PLAIN),
        ("take me home", PLAIN),
        ("Drive FASTER", FASTER),
        ("hurry up", FASTER),
        ("quick, please", FASTER),
        ("schneller", FASTER),
        ("Beeil dich", FASTER),
        ("slow down", SLOWER),
        ("Langsam!", SLOWER),
        ("comfortable", COMFORT),
        ("drive smoothly", COMFORT),
        ("be gentle: gently", COMFORT),
        ("I feel sick", COMFORT),
        ("mehr Komfort", COMFORT),
        ("sanft", COMFORT),
        ("keep your distance", APART),
        ("be careful", APART),
        ("cautious", APART),
        ("mehr Abstand", APART),
        ("Vorsicht", APART),
        (
            "faster, but comfortable and careful",
            replace(COMFORT, speed=3.0, faster=5.0, clearance=8.0),
        ),
    ],
)
def test_commands(text: str | None, expected: Weights) -> None:
    assert Weights.for_command(text) == expected


def course(**changes: list[list[float]] | list[float]) -> Course:
    """Two trajectories of three steps, by default at 10 m/s in the middle of the lane."""
    values = {
        "acceleration": np.zeros((2, 3)),
        "speed": np.full((2, 4), 10.0),
        "lateral": np.zeros((2, 4)),
        "off_centre": np.zeros((2, 4)),
        "duration": np.zeros(2),
    }
    return Course(**{**values, **{name: np.array(value) for name, value in changes.items()}})


def test_jerk_is_the_change_of_the_acceleration_from_the_present_one_on() -> None:
    moving = course(acceleration=[[1.0, 1.0, 2.0], [0.5, 0.5, 0.5]])
    found = costs(moving, replace(NOTHING, jerk=2.0), 10.0, 0.5, 0.1)
    # jerks 5, 0, 10 m/s^3: mean square 125 / 3, over 25
    assert found == pytest.approx([2.0 * 125.0 / 3.0 / 25.0, 0.0])


def test_lateral_acceleration() -> None:
    moving = course(lateral=[[0.0, 2.0, -4.0, 0.0], [2.0, 2.0, 2.0, 2.0]])
    found = costs(moving, replace(NOTHING, lateral=3.0), 10.0, 0.0, 0.1)
    assert found == pytest.approx([3.0 * 5.0 / 4.0, 3.0])


def test_the_centre_counts_in_the_last_half() -> None:
    moving = course(off_centre=[[9.0, 9.0, -1.0, 2.0], [0.0, 0.0, 0.0, 0.5]])
    found = costs(moving, replace(NOTHING, centre=2.0), 10.0, 0.0, 0.1)
    assert found == pytest.approx([2.0 * 1.5**2, 2.0 * 0.25**2])


def test_the_desired_speed() -> None:
    moving = course(speed=[[10.0, 11.0, 12.0, 13.0], [15.0, 15.0, 15.0, 15.0]])
    found = costs(moving, replace(NOTHING, speed=2.0), 12.0, 0.0, 0.1)
    assert found == pytest.approx([2.0 * 1.0 / 5.0, 2.0 * 3.0 / 5.0])


def test_the_duration_of_a_change() -> None:
    found = costs(course(duration=[5.0, 2.0]), replace(NOTHING, change=2.0), 10.0, 0.0, 0.1)
    assert found == pytest.approx([2.0, 0.8])


def test_the_terms_add_up() -> None:
    moving = course(
        acceleration=[[1.0, 0.0, 0.0], [0.0, 0.0, 0.0]],
        speed=[[9.0] * 4, [10.0] * 4],
        lateral=[[1.0] * 4, [0.0] * 4],
        off_centre=[[0.5] * 4, [0.0] * 4],
        duration=[1.0, 0.0],
    )
    weights = Weights(jerk=1.0, lateral=2.0, centre=3.0, speed=4.0, change=5.0)
    alone = [
        costs(moving, replace(NOTHING, **{name: getattr(weights, name)}), 10.0, 0.0, 0.1)
        for name in ("jerk", "lateral", "centre", "speed", "change")
    ]
    assert min(x[0] for x in alone) > 0.0
    assert costs(moving, weights, 10.0, 0.0, 0.1) == pytest.approx(sum(alone))


def test_clearance_costs_below_one_metre() -> None:
    found = clearance_cost(np.array([3.0, 1.0, 0.5, 0.0]), Weights(clearance=4.0))
    assert found == pytest.approx([0.0, 0.0, 1.0, 4.0])
