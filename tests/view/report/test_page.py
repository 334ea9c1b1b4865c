"""The page as a file: nothing in it can break out, its colours can be read, its data are there."""

import base64
import hashlib
import json
import re

import numpy as np
import pytest
import shapely

from report_scenes import HOSTILE, hostile_document, on_the_road
from sandra.actions import ALL_PAIRS
from sandra.decision import decide
from sandra.errors import SandraError
from sandra.reach import Status
from sandra.view.report import Document, decision_document, page, write
from sandra.view.report.document import Decided, plain
from sandra.view.report.html import in_script
from sandra.view.report.packing import unpack_frames, unpack_rows
from sandra.view.report.scenery import STATE
from sandra.view.report.theme import DARK, LIGHT, SHAPES, TEXTS, contrast, css
from sandra.view.shapes import View


def of_the_road() -> Decided:
    found = decision_document(on_the_road()).decisions[0]
    assert isinstance(found, Decided)
    return found


@pytest.mark.parametrize("colours", [LIGHT, DARK], ids=["light", "dark"])
def test_every_colour_can_be_told_from_its_ground(colours: dict[str, str]) -> None:
    texts = {x: contrast(colours[x[0]], colours[x[1]]) for x in TEXTS}
    shapes = {x: contrast(colours[x[0]], colours[x[1]]) for x in SHAPES}
    assert min(texts.values()) >= 4.5, min(texts, key=texts.__getitem__)
    assert min(shapes.values()) >= 3.0, min(shapes, key=shapes.__getitem__)


def test_contrast_is_that_of_the_guideline() -> None:
    assert contrast("#000000", "#ffffff") == pytest.approx(21.0)
    assert contrast("#777777", "#ffffff") == pytest.approx(4.48, abs=0.01)


def test_every_colour_that_is_used_is_there() -> None:
    text = page(Document("decision", "x", ()))
    used = set(re.findall(r"var\(--([\w-]+)\)", text)) | set(re.findall(r"colours\.(\w+)", text))
    assert used - LIGHT.keys() - {"time"} == set()
    assert LIGHT.keys() == DARK.keys()
    assert css().count("--time:") == 3


def test_only_the_one_script_and_style_may_run() -> None:
    text = page(hostile_document())
    (policy,) = re.findall(r'Content-Security-Policy" content="([^"]+)"', text)
    (style,) = re.findall(r"<style>(.*?)</style>", text, re.DOTALL)
    scripts = re.findall(r"<script>(.*?)</script>", text, re.DOTALL)
    assert len(scripts) == 1
    for name, content in (("script", scripts[0]), ("style", style)):
        told = base64.b64encode(hashlib.sha256(content.encode()).digest()).decode()
        assert f"{name}-src 'sha256-{told}'" in policy
    assert "default-src 'none'" in policy
    assert "unsafe" not in policy
    assert "connect-src" not in policy


def test_no_word_of_a_model_is_read_as_html() -> None:
    text = page(hostile_document())
    assert text.count("<script") == text.count("</script>") == 2
    assert "<img" not in text
    assert "<svg" not in text
    (block,) = re.findall(r'id="document">(.*?)</script>', text, re.DOTALL)
    assert not set("<>&\u2028\u2029") & set(block)
    told = json.loads(block)
    assert told["decisions"][0]["answer"]["reasoning"] == HOSTILE
    assert told["title"] == HOSTILE


def test_the_scripts_never_make_html_of_text() -> None:
    text = page(Document("decision", "x", ()), live={})
    for word in (
        "innerHTML",
        "outerHTML",
        "insertAdjacentHTML",
        "document.write",
        "eval(",
        "Function(",
    ):
        assert word not in text


def test_half_a_character_is_written() -> None:
    told = in_script(json.dumps("a\ud800</b>", ensure_ascii=False))
    assert json.loads(told.encode("utf-8")) == "a\ud800</b>"


def test_numbers_that_json_lacks_become_null() -> None:
    assert plain({"a": np.float64("nan"), "b": (float("inf"), np.int64(3))}) == {
        "a": None,
        "b": [None, 3],
    }


def test_a_file_that_cannot_be_written_is_said_in_one_line(tmp_path) -> None:
    with pytest.raises(SandraError, match="cannot be written"):
        write(Document("decision", "x", ()), tmp_path / "none" / "x.html")


def test_all_pairs_are_there_with_their_verdicts() -> None:
    decision, shown = on_the_road(), of_the_road()
    assert {x.pair for x in shown.pairs} == set(map(str, ALL_PAIRS))
    for verdict, pair in zip(decision.verdicts, shown.pairs, strict=True):
        assert (pair.pair, pair.status) == (str(verdict.pair), verdict.status.value)
        assert (pair.empty_step, pair.reason) == (verdict.first_empty_step, verdict.reason)
        assert pair.executed == (verdict.pair == decision.maneuver.pair)
        assert len(unpack_frames(pair.sets)) == len(verdict.reachable_set.steps)
        texts = [shown.parts[name].text for name in pair.parts]
        assert texts == [part.text for part in verdict.specification.parts]


def test_pairs_that_were_not_asked_for_are_said_to_be_so() -> None:
    decision = on_the_road()
    first = decide(
        decision.scene, "rules", prediction="set-based", horizon=8, walk="first", accept="reachable"
    )
    document = decision_document(first)
    (shown,) = document.decisions
    assert isinstance(shown, Decided)
    asked = [x for x in shown.pairs if x.asked]
    assert len(asked) == len(first.verdicts) < 12 == len(shown.pairs)
    assert not any(x.executed for x in shown.pairs if not x.asked)


def test_the_sets_are_where_the_verifier_says() -> None:
    decision, shown = on_the_road(), of_the_road()
    view = View.of(decision.scene)
    verdict = next(v for v in decision.verdicts if v.status is not Status.UNSAFE)
    pair = next(x for x in shown.pairs if x.pair == str(verdict.pair))
    for frame, exact in zip(
        unpack_frames(pair.sets), view.positions(verdict.reachable_set), strict=True
    ):
        drawn = shapely.union_all([shapely.Polygon(ring) for ring in frame])
        assert shapely.hausdorff_distance(drawn, exact) < 0.05


def test_the_others_are_drawn_where_they_may_be() -> None:
    decision, shown = on_the_road(), of_the_road()
    view = View.of(decision.scene)
    for predicted in decision.ground.prediction.obstacles:
        other = next(x for x in shown.others if x.id == predicted.obstacle.id)
        assert other.occupancy is not None
        for k, frame in enumerate(unpack_frames(other.occupancy)):
            drawn = shapely.union_all([shapely.Polygon(ring) for ring in frame])
            exact = view.occupancy(predicted, k)
            assert drawn.symmetric_difference(exact).area < 0.02 * exact.area + 0.1
        states = unpack_rows(other.states, STATE)
        assert np.abs(states[:, :2] - view.points(predicted.states)).max() < 0.006


def test_a_plan_begins_at_the_ego_and_its_fail_safe_stands() -> None:
    shown = of_the_road()
    first = unpack_rows(shown.curves[0].states, STATE)[0]
    assert np.abs(first[:2]).max() < 0.01
    assert shown.executed["kind"] == "certified"
    fail_safe = next(x for x in shown.curves if x.kind == "fail-safe")
    assert unpack_rows(fail_safe.states, STATE)[-1, 3] == pytest.approx(0.0, abs=0.011)
