"""Speed limits, signs and lights along the current lane."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sandra.scene import load
from sandra.scene.regulation import speed_limits
from scene_xml import lanelet, max_speed, points, state, straight

Write = Callable[..., Path]


def sign(id: int, code: str) -> str:
    return (
        f'<trafficSign id="{id}"><trafficSignElement><trafficSignID>{code}</trafficSignID>'
        "</trafficSignElement></trafficSign>"
    )


def chain(signs: dict[int, list[int]], **last: object) -> tuple[str, ...]:
    """Four lanelets of 100 m in a row, the first from 0 to 100."""
    return tuple(
        straight(
            k,
            100.0 * (k - 1),
            100.0 * k,
            0.0,
            successors=[k + 1] if k < 4 else [],
            predecessors=[k - 1] if k > 1 else [],
            signs=signs.get(k, []),
            **(last if k == 4 else {}),
        )
        for k in range(1, 5)
    )


def ego(x: float, step: int = 0) -> str:
    return state("initialState", step, x, 0.0, orientation=0.0, velocity=10.0)


def test_a_limit_stays_in_force_until_the_next_sign(write: Write) -> None:
    road = chain({2: [50], 4: [51]})
    signs = (max_speed(50, 13.89), max_speed(51, 8.33))
    scene = load(write(lanelets=road, others=signs, initial=ego(150.0)))
    assert scene.current.speed_limits == (None, 13.89, 13.89, 8.33)
    assert [lanelet.speed_limit for lanelet in scene.lanelets] == [None, 13.89, 13.89, 8.33]
    assert scene.speed_limit == 13.89
    s = np.array([50.0, 150.0, 299.0, 301.0, 1000.0])
    assert scene.speed_limit_at(s) == (None, 13.89, 13.89, 8.33, 8.33)
    # The list of signs begins with the ego's lanelet; distances are from the ego's front.
    front = 150.0 + scene.ego.length / 2
    assert [(x.id, x.name, x.values) for x in scene.signs] == [
        (50, "max_speed", ("13.89",)),
        (51, "max_speed", ("8.33",)),
    ]
    assert [x.distance for x in scene.signs] == pytest.approx([0.0, 300.0 - front])


def test_the_end_of_a_limit_and_an_unreadable_limit(write: Write) -> None:
    road = chain({1: [50], 3: [51]})
    signs = (max_speed(50, 13.89), sign(51, "278"))
    scene = load(write(lanelets=road, others=signs, initial=ego(150.0)))
    assert scene.current.speed_limits == (13.89, 13.89, None, None)
    word = (max_speed(50, 13.89).replace("13.89", "fast"),)
    assert load(write(lanelets=chain({1: [50]}), others=word, initial=ego(150))).speed_limit is None


@pytest.mark.parametrize(
    ("country", "code"), [("USA", "R2-1"), ("ESP", "r301"), ("DEU", "274"), ("DEU", "274.1")]
)
def test_limits_of_other_countries(write: Write, country: str, code: str) -> None:
    signs = (max_speed(50, 13.89).replace(">274<", f">{code}<"),)
    path = write(
        lanelets=chain({1: [50]}), others=signs, initial=ego(50), id=f"{country}_Test-1_1_T-1"
    )
    assert load(path).speed_limit == 13.89


@given(
    st.dictionaries(st.integers(0, 9), st.sampled_from([None, 5.0, 10.0, 20.0])),
    st.dictionaries(st.integers(0, 9), st.lists(st.integers(0, 9), max_size=3)),
)
def test_limits_are_a_fixed_point(
    own: dict[int, float | None], successors: dict[int, list[int]]
) -> None:
    """Own signs win; elsewhere it is the lowest limit of the predecessors, on circles too."""
    limits = speed_limits(own, successors)
    for i in range(10):
        if i in own:
            assert limits.get(i) == own[i]
            continue
        incoming = [limits[j] for j, to in successors.items() if i in to and j in limits]
        assert limits.get(i) == min(incoming, default=None)


def light(id: int, direction: str = "", offset: int = 0, active: str = "") -> str:
    cycle = "".join(
        f"<cycleElement><duration>{n}</duration><color>{color}</color></cycleElement>"
        for n, color in ((30, "red"), (10, "redYellow"), (40, "green"), (10, "yellow"))
    )
    return (
        f'<trafficLight id="{id}"><cycle>{cycle}<timeOffset>{offset}</timeOffset></cycle>'
        f"{direction}{active}</trafficLight>"
    )


@pytest.mark.parametrize(
    ("step", "expected"),
    [(0, "red"), (29, "red"), (30, "redYellow"), (40, "green"), (80, "yellow"), (90, "red")],
)
def test_the_state_of_a_light_at_the_initial_step(write: Write, step: int, expected: str) -> None:
    road = (straight(1, 0, 200, 0.0, lights=[60]),)
    scene = load(write(lanelets=road, others=(light(60),), initial=ego(50, step)))
    assert [x.state for x in scene.lights] == [expected]
    assert scene.lights[0].distance == pytest.approx(150.0 - scene.ego.length / 2)
    shifted = load(write(lanelets=road, others=(light(60, offset=step),), initial=ego(50, step)))
    assert shifted.lights[0].state == "red"


def test_an_inactive_light_and_the_stop_line(write: Write) -> None:
    line = f"<stopLine>{points([(190, -2), (190, 2)])}<lineMarking>solid</lineMarking></stopLine>"
    road = (straight(1, 0, 200, 0.0, lights=[60], stop_line=line),)
    off = light(60, active="<active>false</active>")
    scene = load(write(lanelets=road, others=(off,), initial=ego(150)))
    assert scene.lights[0].state == "inactive"
    half = scene.ego.length / 2
    assert scene.lights[0].distance == pytest.approx(40.0 - half)
    # The front is beyond the line, the centre is not: the light still counts.
    over = load(write(lanelets=road, others=(off,), initial=ego(189)))
    assert over.lights[0].distance == pytest.approx(1.0 - half)
    assert load(write(lanelets=road, others=(off,), initial=ego(191))).lights == ()


def test_arrows_count_where_the_lane_turns_that_way(write: Write) -> None:
    road = (
        straight(1, 0, 100, 0.0, successors=[2, 3], lights=[60, 61, 62]),
        straight(2, 100, 200, 0.0, predecessors=[1]),
        lanelet(3, [(100, 2), (118, 20)], [(100, -2), (122, 20)], predecessors=[1]),
    )
    intersection = (
        '<intersection id="70"><incoming id="71"><incomingLanelet ref="1"/>'
        '<successorsStraight ref="2"/><successorsLeft ref="3"/></incoming></intersection>'
    )
    lights = (
        light(60, "<direction>left</direction>"),
        light(61, "<direction>straightRight</direction>"),
        light(62),
    )
    scene = load(write(lanelets=road, others=(*lights, intersection), initial=ego(20)))
    assert scene.current.lanelets == (1, 2)
    assert [x.id for x in scene.lights] == [61, 62]
    assert load(write(lanelets=road, others=lights, initial=ego(20))).lights != ()
