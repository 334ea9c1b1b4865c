"""What is told apart in a figure is told apart in a grey print: by lightness, hatching or line."""

from itertools import combinations

import numpy as np
import pytest

from sandra.view import palette
from sandra.view.ablation import _AGAIN, _LOOKS
from sandra.view.distribution import LOOKS
from sandra.view.robustness import COMPARED, STYLES

APART = 12.0
"""CIE lightness that two areas differ by at least; 2.3 is about what can just be seen."""


def lightness(colour: object) -> float:
    """CIE L* (0 black, 100 white) of a colour: what a grey print keeps of it."""
    from matplotlib.colors import to_rgb

    rgb = np.array(to_rgb(colour))
    linear = np.where(rgb <= 0.04045, rgb / 12.92, ((rgb + 0.055) / 1.055) ** 2.4)
    luminance = float(linear @ [0.2126, 0.7152, 0.0722])
    return 116 * np.cbrt(luminance) - 16 if luminance > 0.008856 else 903.3 * luminance


def told_apart(one: tuple[str, str], other: tuple[str, str]) -> bool:
    """By lightness, or else by hatching."""
    return one[1] != other[1] or abs(lightness(one[0]) - lightness(other[0])) >= APART


def test_lightness() -> None:
    assert lightness("#000000") == pytest.approx(0.0, abs=0.1)
    assert lightness("#ffffff") == pytest.approx(100.0, abs=0.1)
    assert lightness("#777777") == pytest.approx(50.0, abs=0.6)
    assert not told_apart(("#0072B2", ""), ("#0071b1", ""))


def test_runs_of_an_ablation() -> None:
    looks = [(colour, hatch + again) for again in _AGAIN for colour, hatch in _LOOKS]
    bad = [pair for pair in combinations(looks, 2) if not told_apart(*pair)]
    assert bad == []


@pytest.mark.parametrize(
    "names",
    [("keep", "accelerate", "decelerate", "stop"), ("follow-lane", "left-lane", "right-lane")],
)
def test_actions_of_a_distribution(names: tuple[str, ...]) -> None:
    bad = [pair for pair in combinations(names, 2) if not told_apart(*(LOOKS[x] for x in pair))]
    assert bad == []


def test_lines() -> None:
    assert len({line for _, line, _ in COMPARED}) == len(COMPARED)
    assert len({line for _, line, _ in STYLES.values()}) == len(STYLES)
    assert len({str(style["linestyle"]) for style in palette.LINES.values()}) == len(palette.LINES)


def test_bodies_lanes_and_occupancies() -> None:
    now = [palette.EGO, palette.OTHER, palette.LANE]
    for one, other in combinations(now, 2):
        assert abs(lightness(one) - lightness(other)) >= APART
    occupancies = [lightness(palette.faded(palette.OCCUPANCY, p)) for p in np.linspace(0.42, 0.88)]
    assert np.all(np.diff(occupancies) > 0), "the later the fainter"


def test_time_grows_lighter() -> None:
    steps = [lightness(palette.time_map()(x)) for x in np.linspace(0, 1, 26)]
    assert np.all(np.diff(steps) > 1.0)
    assert steps[-1] - steps[0] > 60


def test_verdicts_have_symbols() -> None:
    assert len({style.symbol for style in palette.STATUS.values()}) == 3
