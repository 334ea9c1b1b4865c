"""One decision as the page shows it: what was seen, told, answered, verified, chosen."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np
import shapely

from sandra.actions import ALL_PAIRS, ActionPair
from sandra.certify import Proven
from sandra.decision import Decision
from sandra.logic import Specification, Vocabulary
from sandra.planning import Maneuver
from sandra.reach import Status, Verdict, verify_on
from sandra.scene.types import Scene
from sandra.view.header import kind_of_ranker
from sandra.view.report.curves import curves
from sandra.view.report.document import Answer, Decided, Map, Pair, Part, Prompt
from sandra.view.report.scenery import frames_of, map_of, marks_of, others_of
from sandra.view.sets import blocking
from sandra.view.shapes import View, bounds, grown


def decided(
    decision: Decision,
    *,
    view: View | None = None,
    step: int = 0,
    time: float = 0.0,
    map_index: int = 0,
    texts: list[str] | None = None,
    operation: str | None = None,
    covered: bool | None = None,
    all_pairs: bool = True,
    vocabulary: Vocabulary | None = None,
) -> Decided:
    """A decision for the page.

    Args:
        view: whose coordinates are meant; default: those of the decision's own scene.
        step, time, operation, covered: where it stands in an episode [s].
        map_index: of its map in the document. texts: those of the document, to which new ones
            are added.
        all_pairs: whether pairs that the decision did not verify are verified now, on the same
            ground, for the page alone; nothing of the decision changes.
        vocabulary: the one that the decision was made with, if not the packaged one.
    """
    scene = decision.scene
    view = _view_of(scene, view)
    verdicts = [(verdict, True) for verdict in decision.verdicts]
    if all_pairs:
        more = _missing(decision, vocabulary)
        verdicts += [(verdict, False) for verdict in more]
    shapes = {verdict.pair: view.positions(verdict.reachable_set) for verdict, _ in verdicts}
    pairs = tuple(_pair(decision, verdict, asked, view, shapes) for verdict, asked in verdicts)
    state = scene.ego.state
    x, y = view.points(np.array([[state.x, state.y]]))[0].tolist()
    return Decided(
        step=step,
        time=time,
        scenario=scene.name,
        dt=scene.dt,
        horizon=decision.ground.horizon,
        map=map_index,
        focus=_focus(view, decision.maneuver, [s for found in shapes.values() for s in found]),
        ego={
            "id": scene.ego.id,
            "length": scene.ego.length,
            "width": scene.ego.width,
            "x": x,
            "y": y,
            "heading": state.heading - view.angle,
            "speed": state.speed,
            "acceleration": state.acceleration,
        },
        others=others_of(view, decision.ground.prediction),
        marks=marks_of(view),
        parts=_parts(verdict.specification for verdict, _ in verdicts),
        pairs=pairs,
        curves=curves(view, decision.maneuver),
        executed={
            "kind": decision.maneuver.kind,
            "pair": None if decision.maneuver.pair is None else str(decision.maneuver.pair),
            "note": decision.maneuver.note,
        },
        settings=_settings(decision),
        prompt=_prompt(decision, [] if texts is None else texts),
        answer=_answer(decision),
        durations_s=dict(decision.durations_s),
        operation=operation,
        covered=covered,
    )


def map_of_decision(decision: Decision, view: View | None = None) -> Map:
    """The road around a decision."""
    scene = decision.scene
    view = _view_of(scene, view)
    return map_of(view, scene)


def _view_of(scene: Scene, view: View | None) -> View:
    return View.of(scene) if view is None else replace(view, scene=scene)


def _missing(decision: Decision, vocabulary: Vocabulary | None) -> Sequence[Verdict]:
    known = {verdict.pair for verdict in decision.verdicts}
    pairs = [pair for pair in ALL_PAIRS if pair not in known]
    rules = decision.verdicts.rules
    return tuple(verify_on(decision.ground, pairs, rules, vocabulary=vocabulary)) if pairs else ()


def _pair(
    decision: Decision,
    verdict: Verdict,
    asked: bool,
    view: View,
    shapes: dict[ActionPair, list[shapely.Geometry]],
) -> Pair:
    ranked = decision.ranking.pairs
    holds = verdict.status is not Status.UNSAFE
    corridor = view.positions(verdict.reachable_set.corridor()) if holds else None
    contested = view.contested(verdict.reachable_set)
    obstacles = decision.ground.prediction.obstacles
    proof = verdict.proof
    return Pair(
        pair=str(verdict.pair),
        rank=ranked.index(verdict.pair) + 1 if verdict.pair in ranked else None,
        asked=asked,
        status=verdict.status.value,
        empty_step=verdict.first_empty_step,
        reason=verdict.reason,
        executed=asked and decision.maneuver.pair == verdict.pair,
        duration_s=verdict.duration_s,
        parts=tuple(part.name for part in verdict.specification.parts),
        sets=frames_of(shapes[verdict.pair]),
        areas=tuple(round(float(shape.area), 2) for shape in shapes[verdict.pair]),
        corridor=None if corridor is None else frames_of(corridor),
        contested=None if contested.is_empty else frames_of([contested]),
        blocking=tuple(obstacles[i].obstacle.id for i in blocking(verdict, decision.ground)),
        proven=str(proof.report) if isinstance(proof, Proven) else None,
    )


def _parts(specifications: Iterable[Specification]) -> dict[str, Part]:
    return {
        part.name: Part(part.name, part.text, str(part.formula), part.description)
        for specification in specifications
        for part in specification.parts
    }


def _focus(
    view: View, maneuver: Maneuver, shapes: list[shapely.Geometry]
) -> tuple[float, float, float, float]:
    scene = view.scene
    state = scene.ego.state
    seen = [view.body(scene.ego.outline, (state.x, state.y, state.heading)), *shapes]
    path = view.points(maneuver.states)
    seen.append(shapely.MultiPoint(path[np.isfinite(path).all(axis=1)]))
    window = bounds(seen)
    assert window is not None
    low_x, high_x, low_y, high_y = (round(x, 2) for x in grown(window, 8.0, 5.0))
    return low_x, high_x, low_y, high_y


def _settings(decision: Decision) -> dict[str, object]:
    base = decision.ground
    settings = base.settings
    return {
        "prediction": base.prediction.kind,
        "rules": list(decision.verdicts.rules),
        "accept": decision.accept,
        "mode": decision.mode,
        "command": decision.prompt.situation.command,
        "notes": list(base.prediction.notes),
        "speed_limit": decision.scene.speed_limit,
        "a_min": settings.a_lon_min,
        "a_max": settings.a_lon_max,
    }


def _prompt(decision: Decision, texts: list[str]) -> Prompt:
    prompt = decision.prompt
    shared = prompt.system, json.dumps(prompt.schema, indent=1)
    texts += [text for text in dict.fromkeys(shared) if text not in texts]
    system, schema = map(texts.index, shared)
    picture = None if prompt.picture is None else prompt.picture.data_url
    return Prompt(system, prompt.user, schema, picture)


def _answer(decision: Decision) -> Answer:
    ranking = decision.ranking
    return Answer(
        ranker=ranking.ranker,
        told=kind_of_ranker(ranking.ranker) or "",
        ranking=tuple(map(str, ranking.pairs)),
        answer=ranking.answer,
        reasoning=ranking.reasoning,
        failure=None if ranking.failure is None else ranking.failure.value,
        detail=ranking.detail,
        warnings=ranking.warnings,
        usage=None if ranking.usage is None else ranking.usage.to_dict(),
        cached=ranking.cached,
    )
