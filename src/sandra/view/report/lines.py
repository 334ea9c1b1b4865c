"""Decisions of a run that holds no view.jsonl: what decisions.jsonl tells of them."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from sandra.actions import ActionPair
from sandra.errors import SandraError
from sandra.logic import Vocabulary
from sandra.planning import Maneuver
from sandra.view.header import kind_of_ranker
from sandra.view.report.curves import curves
from sandra.view.report.document import Answer, Decided, Pair, Part, Prompt, plain
from sandra.view.report.packing import pack_frames
from sandra.view.shapes import View

ASIDE = 12.0
"""What is seen beside the path [m]."""


def decisions_of(file: Path, view: View) -> tuple[list[dict[str, Any]], list[str]]:
    """The decisions as a document holds them, and the texts that they share.

    Raises:
        SandraError: names the line that cannot be used.
    """
    texts: list[str] = []
    found = []
    try:
        lines = file.read_text(encoding="utf-8").splitlines()
    except OSError as error:
        raise SandraError(f"{file}: cannot be read ({error.strerror})") from None
    for number, line in enumerate(lines, start=1):
        try:
            found.append(plain(_decided(json.loads(line), view, texts)))
        except (ValueError, KeyError, TypeError, AttributeError) as error:
            raise SandraError(f"{file}, line {number}: is no decision ({error})") from None
    return found, texts


def _decided(told: dict[str, Any], view: View, texts: list[str]) -> Decided:
    maneuver, ego = _maneuver(told), view.scene.ego
    here = maneuver.states[0]
    x, y = view.points(here[None, :2])[0].tolist()
    path = view.points(maneuver.states)
    low, high = path.min(axis=0), path.max(axis=0)
    pairs = tuple(_pair(verdict, told) for verdict in told["verdicts"])
    vocabulary = Vocabulary.default()
    names = dict.fromkeys(name for pair in pairs for name in pair.parts)
    parts = {
        x: Part(x, _text(x, vocabulary), _text(x, vocabulary), _words(x, vocabulary)) for x in names
    }
    return Decided(
        step=int(told["step"]),
        time=int(told["step"]) * float(told["dt"]),
        scenario=str(told["scenario"]),
        dt=float(told["dt"]),
        horizon=int(told["horizon"]),
        map=0,
        focus=(low[0] - 10.0, high[0] + 10.0, low[1] - ASIDE, high[1] + ASIDE),
        ego={
            "id": ego.id,
            "length": ego.length,
            "width": ego.width,
            "x": x,
            "y": y,
            "heading": float(here[2] - view.angle),
            "speed": float(here[3]),
            "acceleration": float(here[4]),
        },
        others=(),
        marks=(),
        parts=parts,
        pairs=pairs,
        curves=curves(view, maneuver),
        executed={
            "kind": maneuver.kind,
            "pair": _name(told["executed"]),
            "note": maneuver.note,
        },
        settings={
            "prediction": told["prediction"],
            "rules": told["rules"],
            "accept": told["accept"],
            "mode": told["mode"],
            "command": None,
            "notes": told["assumed"],
            "speed_limit": None,
            "a_min": None,
            "a_max": None,
        },
        prompt=_prompt(told["prompt"], texts),
        answer=_answer(told),
        durations_s=told["durations_s"],
        operation=told.get("operation"),
        covered=told.get("covered"),
    )


def _maneuver(told: dict[str, Any]) -> Maneuver:
    data = told["maneuver"]
    fail_safe = data["fail_safe"]
    return Maneuver(
        told["executed"]["kind"],
        None if (name := _name(told["executed"])) is None else ActionPair.parse(name),
        np.array(data["states"], dtype=float),
        float(told["dt"]),
        str(data["note"]),
        None if fail_safe is None else np.array(fail_safe, dtype=float),
        float(data["fail_safe_start"]),
    )


def _name(entry: dict[str, Any]) -> str | None:
    pair = entry.get("longitudinal")
    return None if pair is None else f"{pair},{entry['lateral']}"


def _pair(verdict: dict[str, Any], told: dict[str, Any]) -> Pair:
    name = _name(verdict)
    assert name is not None
    ranked = [_name(entry) for entry in told["ranking"]]
    return Pair(
        pair=name,
        rank=ranked.index(name) + 1 if name in ranked else None,
        asked=True,
        status=str(verdict["status"]),
        empty_step=verdict["first_empty_step"],
        reason=verdict["reason"],
        executed=_name(told["executed"]) == name,
        duration_s=float(verdict["duration_s"]),
        parts=(verdict["longitudinal"], verdict["lateral"], *told["rules"]),
        sets=pack_frames([]),
        areas=(),
        corridor=None,
        contested=None,
        blocking=(),
        proven=None,
    )


def _text(name: str, vocabulary: Vocabulary) -> str:
    return vocabulary.actions.get(name) or vocabulary.rules.get(name) or name


def _words(name: str, vocabulary: Vocabulary) -> str:
    return vocabulary.descriptions.get(name, "")


def _prompt(told: dict[str, Any], texts: list[str]) -> Prompt:
    shared = str(told["system"]), json.dumps(told["schema"], indent=1)
    texts += [text for text in dict.fromkeys(shared) if text not in texts]
    system, schema = map(texts.index, shared)
    return Prompt(system, str(told["user"]), schema, None)


def _answer(told: dict[str, Any]) -> Answer:
    return Answer(
        ranker=str(told["ranker"]),
        told=kind_of_ranker(str(told["ranker"])) or "",
        ranking=tuple(name for entry in told["ranking"] if (name := _name(entry))),
        answer=told["answer"],
        reasoning=told["reasoning"],
        failure=told["failure"],
        detail=told["failure_detail"],
        warnings=tuple(told["warnings"]),
        usage=told["usage"],
        cached=bool(told["cached"]),
    )
