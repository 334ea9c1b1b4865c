"""The pictures themselves: written, complete, repeatable, and legible whatever the words are."""

import sys
from dataclasses import replace
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.text import Text

from sandra.actions import ALL_PAIRS, ActionPair
from sandra.decision import Decision, decide
from sandra.describe import Prompt
from sandra.planning import full_braking
from sandra.prediction import predict
from sandra.rankers import Failure, Ranking
from sandra.reach import Status, verify
from sandra.scene import load
from sandra.scene.types import Region, Scene, TrafficLight, TrafficSign
from sandra.view import decision_figure, scene_figure, verdict_figure
from sandra.view.page import Page
from sandra.view.scene import draw_bodies
from sandra.view.sets import blocking
from sandra.view.shapes import View
from sandra.view.sheet import compose
from straight_road import Road

HORIZON = 8
HOSTILE = "$\\frac{1}{0$ \n\x00 漢字🚗 " + "x" * 10_000


class Fixed:
    """A ranker that always gives the same answer."""

    name = "fixed"

    def __init__(self, *pairs: str, failure: Failure | None = None, detail: str | None = None):
        self._pairs = tuple(ActionPair.parse(pair) for pair in pairs)
        self._failure, self._detail = failure, detail

    def rank(self, prompt: Prompt, deadline: float | None = None) -> Ranking:
        return Ranking(self._pairs, self.name, self._failure, self._detail)


def street(**changes: Any) -> Scene:
    """Three lanes with something across them, a car, a pedestrian, a light, signs, a goal."""
    road = Road(angle=0.8, x=5.0, y=-30.0)
    goal = Region.rectangle(8.0, 3.0).placed(*road.at(30.0, 0.0), road.angle)
    return road.scene(
        road.obstacle(10, 10.4, 0.0, kind="truck", outline=Region.rectangle(2.0, 12.0)),
        road.obstacle(11, 20.0, 3.5, speed=8.0),
        road.obstacle(12, 4.0, -3.5, kind="pedestrian", outline=Region.disc(0.4)),
        lanes=road.three_lanes(),
        lights=(TrafficLight(5, "red", 25.0),),
        signs=(TrafficSign(6, "max_speed", ("13.89",), 0.0), TrafficSign(7, "yield", (), 20.0)),
        goal=goal,
        **{"speed": 12.0, **changes},
    )


@pytest.fixture(scope="module")
def decision() -> Decision:
    ranker = Fixed("accelerate,follow-lane", "keep,follow-lane", "decelerate,follow-lane")
    return decide(street(), ranker, "drive faster", horizon=HORIZON, accept="reachable")


@pytest.fixture
def pages(monkeypatch: pytest.MonkeyPatch) -> list[Page]:
    """Every page that is composed."""
    made: list[Page] = []

    def kept(*args: Any, **options: Any) -> Page:
        made.append(compose(*args, **options))
        return made[-1]

    monkeypatch.setattr("sandra.view.decision.compose", kept)
    return made


def words(page: Page) -> str:
    return "\n".join(t.get_text() for t in page.figure.findobj(Text) if t.get_text())


def drawn_texts(page: Page) -> list[Text]:
    """Every text but those of the 3-D view and the ticks beyond the limits of their axes."""
    left_out = set()
    for ax in page.figure.axes:
        if ax.name == "3d":
            left_out |= set(ax.findobj(Text))
            continue
        for axis, place in ((ax.xaxis, 0), (ax.yaxis, 1)):
            low, high = axis.get_view_interval()
            for label in axis.get_ticklabels(which="both"):
                if not low <= label.get_position()[place] <= high:
                    left_out.add(label)
    return [
        text
        for text in page.figure.findobj(Text)
        if text.get_text().strip() and text.get_visible() and text not in left_out
    ]


def assert_legible(page: Page) -> None:
    """No two texts overlap and none leaves the page."""
    renderer = page.figure.canvas.get_renderer()
    found = [(t.get_text(), t.get_window_extent(renderer)) for t in drawn_texts(page)]
    wide, high = page.figure.bbox.width, page.figure.bbox.height
    for text, box in found:
        assert box.x0 >= -1, text
        assert box.x1 <= wide + 1, text
        assert box.y0 >= -1, text
        assert box.y1 <= high + 1, text
    for (a, box), (b, other) in combinations(found, 2):
        apart_x = min(box.x1, other.x1) - max(box.x0, other.x0)
        apart_y = min(box.y1, other.y1) - max(box.y0, other.y0)
        # Boxes include the empty space above and below the letters.
        assert apart_x <= 1.0 or apart_y <= 2.5, f"{a!r} lies on {b!r}"


def test_a_decision_shows_all_its_parts(
    decision: Decision, pages: list[Page], tmp_path: Path
) -> None:
    path = decision_figure(decision, tmp_path / "d.png")
    assert path.read_bytes().startswith(b"\x89PNG")
    page = pages[0]
    # The map, time upwards, the colour bar; what is driven, its speed and its acceleration; and
    # one panel per pair.
    assert len(page.figure.axes) == 3 + 3 + 3
    assert sum(ax.name == "3d" for ax in page.figure.axes) == 1
    shown = words(page)
    for text in ("TST_Straight-1_1_T-1", "fixed", "drive faster", "most-likely", "h = 8"):
        assert text in shown
    for verdict in decision.verdicts:
        symbol = "✗" if verdict.status is Status.UNSAFE else "✓"
        assert f"{symbol} {verdict.status.value}" in shown
        if verdict.first_empty_step is not None:
            assert f"empty at step {verdict.first_empty_step}" in shown
    assert {v.status for v in decision.verdicts} == set(Status) - {Status.CERTIFIED}
    assert shown.count("▶ executed") == 1
    assert_legible(page)


def test_same_input_same_bytes_and_no_pyplot(
    decision: Decision, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # None makes every import of it fail.
    monkeypatch.setitem(sys.modules, "matplotlib.pyplot", None)
    first = decision_figure(decision, tmp_path / "a.png", dpi=40).read_bytes()
    assert decision_figure(decision, tmp_path / "b.png", dpi=40).read_bytes() == first


@pytest.mark.parametrize(("suffix", "begin"), [("pdf", b"%PDF"), ("svg", b"<?xml")])
def test_vector_formats_without_the_3d_view(
    decision: Decision, pages: list[Page], tmp_path: Path, suffix: str, begin: bytes
) -> None:
    content = decision.figure(tmp_path / f"d.{suffix}", three_d=False).read_bytes()
    assert len(pages[0].figure.axes) == 2 + 3 + 3
    assert content.startswith(begin)
    # No date, so that the same input can give the same file.
    assert b"CreationDate" not in content
    assert b"<dc:date>" not in content


def test_all_twelve_in_the_order_of_the_paper(pages: list[Page], tmp_path: Path) -> None:
    verdicts = verify(street(), reversed(ALL_PAIRS), horizon=HORIZON, reasons=False)
    verdicts.figure(tmp_path / "v.png", dpi=60, three_d=False)
    page = pages[0]
    assert len(page.figure.axes) == 2 + 12
    titles = [t.get_text() for t in page.figure.texts]
    names = [f"{p.longitudinal.value}, {p.lateral.value}" for p in ALL_PAIRS]
    assert [t for t in titles if t in names][:12] == names
    assert_legible(page)


def test_hostile_words(decision: Decision, pages: list[Page], tmp_path: Path) -> None:
    verdicts = decision.verdicts
    unsafe = next(v for v in verdicts if v.status is Status.UNSAFE)
    bad = replace(
        decision,
        scene=replace(decision.scene, name=HOSTILE),
        prompt=replace(
            decision.prompt, situation=replace(decision.prompt.situation, command=HOSTILE)
        ),
        ranking=replace(
            decision.ranking, ranker=HOSTILE, failure=Failure.MALFORMED, detail=HOSTILE
        ),
        verdicts=replace(
            verdicts,
            verdicts=tuple(replace(v, reason=HOSTILE) if v is unsafe else v for v in verdicts),
            rules=(HOSTILE,),
        ),
        maneuver=replace(decision.maneuver, note=HOSTILE),
    )
    decision_figure(bad, tmp_path / "d.png", dpi=60, three_d=False)
    assert "$\\frac{1}{0$" in words(pages[0])
    assert "malformed" in words(pages[0])
    assert_legible(pages[0])


def test_nothing_ranked(pages: list[Page], tmp_path: Path) -> None:
    ranker = Fixed(failure=Failure.TIMEOUT, detail="no answer within 30 s")
    decision = decide(street(), ranker, horizon=HORIZON, accept="reachable")
    decision_figure(decision, tmp_path / "d.png", dpi=60)
    assert len(pages[0].figure.axes) == 3 + 3
    shown = words(pages[0])
    assert "timeout" in shown
    assert "fail-safe" in shown
    assert "▶" not in shown
    assert_legible(pages[0])


@pytest.mark.parametrize("period", [None, 0.5, 0.8])
def test_a_certified_decision_shows_both_trajectories_and_when_they_part(
    pages: list[Page], tmp_path: Path, period: float | None
) -> None:
    road = Road(angle=2.5, x=50.0)
    scene = road.scene(
        road.obstacle(11, 60.0, 0.0, speed=13.0),
        road.obstacle(12, -20.0, 3.5, speed=13.0),
        lanes=road.three_lanes(),
        speed=13.0,
    )
    decision = decide(
        scene, Fixed("decelerate,follow-lane"), horizon=HORIZON, decision_period=period
    )
    assert decision.maneuver.kind == "certified"
    decision_figure(decision, tmp_path / "d.png")
    page = pages[0]
    # The map, time upwards, the colour bar; two strips and two profiles; the panel.
    assert len(page.figure.axes) == 3 + 4 + 1
    shown = words(page)
    assert "planned: decelerate, follow-lane, through 0.8 s" in shown
    assert "fail-safe if no new decision comes: stands at" in shown
    assert f"next decision due at {decision.maneuver.fail_safe_start:g} s" in shown
    assert "speed limit" in shown
    assert_legible(page)
    # Told apart without colour: three different dashes on the map and in the profiles.
    for ax in (page.figure.axes[0], page.figure.axes[-3], page.figure.axes[-2]):
        wide = [line for line in ax.get_lines() if line.get_linewidth() >= 1.3]
        dashes = {str(line.get_linestyle()) + str(line._dash_pattern) for line in wide}
        assert len(dashes) >= (2 if period == 0.8 else 3)


def test_the_fail_safe_profile_ends_at_zero(pages: list[Page], tmp_path: Path) -> None:
    decision = decide(street(), Fixed(failure=Failure.EMPTY), horizon=HORIZON)
    assert decision.maneuver.kind == "fail-safe"
    decision_figure(decision, tmp_path / "d.png", three_d=False)
    speed = next(ax for ax in pages[0].figure.axes if "stands at" in _texts(ax))
    curve = max(speed.get_lines(), key=lambda line: len(line.get_xdata()))
    assert curve.get_ydata()[0] == pytest.approx(decision.scene.ego.state.speed)
    assert curve.get_ydata()[-1] == pytest.approx(0.0, abs=1e-6)
    assert (np.diff(curve.get_ydata()) <= 1e-9).all()
    assert_legible(pages[0])


def _texts(ax: Any) -> str:
    return "\n".join(text.get_text() for text in ax.texts)


@pytest.mark.parametrize("accept", ["certified", "reachable"])
def test_a_standing_ego(pages: list[Page], tmp_path: Path, accept: str) -> None:
    for pairs in (("stop,follow-lane",), ("accelerate,follow-lane",), ()):
        ranker = Fixed(*pairs, failure=None if pairs else Failure.EMPTY)
        decision = decide(street(speed=0.0), ranker, horizon=HORIZON, accept=accept)
        decision_figure(decision, tmp_path / "d.png", three_d=False)
        assert_legible(pages[-1])
        assert "speed and acceleration" in words(pages[-1])


def test_who_is_in_the_way_is_named_by_the_reason(decision: Decision) -> None:
    unsafe = next(v for v in decision.verdicts if v.status is Status.UNSAFE)
    base = decision.ground
    found = blocking(replace(unsafe, reason="car 10 leaves no room"), base)
    assert [base.prediction.obstacles[i].obstacle.id for i in found] == [10]
    assert blocking(replace(unsafe, reason="action keep cannot be kept"), base) == []
    assert blocking(replace(unsafe, reason=None), base) == []


def test_a_pair_that_holds_but_was_passed_over_says_so(
    decision: Decision, pages: list[Page], tmp_path: Path
) -> None:
    braking = full_braking(decision.scene, decision.ground.settings)
    decision_figure(replace(decision, maneuver=braking), tmp_path / "d.png", three_d=False)
    assert "no trajectory was found" in words(pages[0])
    assert_legible(pages[0])


@pytest.mark.parametrize("prediction", [None, "set-based"])
def test_a_scene_alone(tmp_path: Path, prediction: str | None) -> None:
    scene = street(weather="rain", country="DEU")
    foreseen = None if prediction is None else predict(scene, prediction, HORIZON)
    path = scene_figure(scene, tmp_path / "s.png", foreseen, dpi=60)
    assert path.stat().st_size > 5_000


def test_an_obstacle_that_comes_later_is_not_drawn_now() -> None:
    road = Road()
    states = np.full((9, 5), np.nan)
    states[4:] = [15.0, 3.5, 0.0, 5.0, 0.0]
    late = road.obstacle(77, 15.0, 3.5, 5.0, states=states)
    present = road.obstacle(78, 15.0, -3.5, 5.0)
    scene = road.scene(late, present, lanes=road.three_lanes())
    ax = Page(4.0, 3.0).axes(0.5, 0.5, 3.0, 2.0)
    drawn = draw_bodies(ax, View.of(scene), (-20.0, 40.0, -9.0, 9.0))
    assert [obstacle.id for obstacle, _ in drawn] == [78]


def test_verdicts_of_one_pair(pages: list[Page], tmp_path: Path) -> None:
    verdicts = verify(street(), "stop,follow-lane", horizon=HORIZON, rules=["R_G1"])
    verdict_figure(verdicts, tmp_path / "v.png", dpi=60, three_d=False)
    assert len(pages[0].figure.axes) == 3
    assert "R_G1" in words(pages[0])
    assert_legible(pages[0])


def test_the_case_study(shared: Path, pages: list[Page], tmp_path: Path) -> None:
    scene = load(shared / "data" / "scenarios" / "DEU_Goeppingen-37_1_T-4.xml")
    pairs = ["accelerate,right-lane", "decelerate,follow-lane"]
    verdicts = verify(scene, pairs, horizon=6, reasons=False)
    verdict_figure(verdicts, tmp_path / "v.png")
    assert_legible(pages[0])
