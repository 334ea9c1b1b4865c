"""One window of a recording under several setups: label, prompt, ranking, verdicts, durations."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

from sandra.actions import ALL_PAIRS, ActionPair, Lateral, Longitudinal
from sandra.certify import Basis, certify
from sandra.describe import describe
from sandra.errors import SandraError
from sandra.evaluation.labelling.batch import (
    Choice,
    Places,
    Window,
    told,
    windows_at,
    windows_of,
)
from sandra.evaluation.labelling.summary import UNKNOWN
from sandra.evaluation.open_loop.setups import TOLD_RULES, Conditions, Setup
from sandra.learn import label
from sandra.prediction import predict
from sandra.rankers import Ranker, create
from sandra.reach import Ground, Status, Verdict, explained, ground, verify_on
from sandra.scene.types import Scene

MILDEST = ActionPair(Longitudinal.DECELERATE, Lateral.FOLLOW_LANE)


@dataclass(frozen=True, slots=True, eq=False)
class Judged:
    """All twelve pairs at one horizon: which are verified, and what that took [s]."""

    base: Ground
    status: Mapping[ActionPair, Status]
    verified: frozenset[ActionPair]
    predict_s: float
    exhaustive_s: float
    because: str | None = None
    """Where nothing is verified: what is wrong with decelerate, follow-lane."""


def rows_of(
    path: Path,
    setups: Sequence[Setup],
    choice: Choice,
    conditions: Conditions,
    places: Places | None = None,
) -> dict[str, list[dict[str, Any]]]:
    """By setup, the rows of one file; never none. What cannot be used is a row with its error."""
    found: dict[str, list[dict[str, Any]]] = {setup.name: [] for setup in setups}

    def note(row: dict[str, Any], error: str) -> None:
        for setup in setups:
            found[setup.name].append(_empty(path, setup, choice, error) | row)

    try:
        found_windows = (
            windows_of(path, choice) if places is None else windows_at(path, places, choice)
        )
        for window in found_windows:
            row = {"ego_id": window.ego, "kind": window.kind, "step": window.step}
            try:
                for name, answer in _of_window(path, window, setups, choice, conditions).items():
                    found[name].append(answer | row)
            except SandraError as error:
                note(row, str(error))
    except SandraError as error:
        note({}, str(error))
    if not all(found.values()):
        note({}, f"{path}: there is no window; choose a shorter horizon")
    return found


def _of_window(
    path: Path,
    window: Window,
    setups: Sequence[Setup],
    choice: Choice,
    conditions: Conditions,
) -> dict[str, dict[str, Any]]:
    scene = window.scene
    if scene is None:
        raise SandraError(window.error or "there is no scene")
    labelled = told(label(scene, choice.horizon, choice.labeler, choice.settings))
    # Whoever is asked must not see what was driven.
    scene = replace(scene, recorded_ego=None)
    judged: dict[int, Judged] = {}
    rows = {}
    for setup in setups:
        if setup.horizon not in judged:
            judged[setup.horizon] = judge(scene, setup.horizon, conditions)
        row = _empty(path, setup, choice, None) | {"scenario_id": scene.name, "dt": scene.dt}
        answered = _asked(scene, setup, conditions, judged[setup.horizon])
        rows[setup.name] = row | labelled | answered
    return rows


def judge(scene: Scene, horizon: int, conditions: Conditions) -> Judged:
    """Exhaustive enumeration: verdicts of all twelve pairs."""
    settings = conditions.settings.replace(horizon=horizon)
    begin = time.perf_counter()
    base = ground(scene, predict(scene, conditions.prediction, horizon, settings), settings)
    ready = time.perf_counter()
    verdicts: Sequence[Verdict] = tuple(verify_on(base, ALL_PAIRS, conditions.rules, reasons=False))
    enough = Status.REACHABLE
    if conditions.accept == "certified":
        enough, basis = Status.CERTIFIED, Basis.of(base)
        verdicts = tuple(certify(basis, verdict, conditions.rules) for verdict in verdicts)
    done = time.perf_counter()
    status = {verdict.pair: verdict.status for verdict in verdicts}
    verified = frozenset(pair for pair, found in status.items() if found is enough)
    because = None
    if not verified:
        mildest = next(verdict for verdict in verdicts if verdict.pair == MILDEST)
        because = explained(base, mildest).reason
    return Judged(base, status, verified, ready - begin, done - ready, because)


def _asked(scene: Scene, setup: Setup, conditions: Conditions, judged: Judged) -> dict[str, Any]:
    settings = conditions.settings.replace(horizon=setup.horizon, k=conditions.k)
    prompt = describe(
        scene,
        setup.command,
        rules=conditions.rules or TOLD_RULES,
        rule_prompt=setup.rule_prompt,
        settings=settings,
    )
    ranker = _ranker(setup.ranker, conditions.base_url, conditions.deadline)
    begin = time.perf_counter()
    ranking = ranker.rank(prompt, conditions.deadline)
    ranked = time.perf_counter()
    verify_on(judged.base, ranking.pairs, conditions.rules, reasons=False)
    verified = time.perf_counter()
    return {
        "prompt": {"system": prompt.system, "user": prompt.user},
        "feasible": [str(pair) for pair in prompt.feasible],
        "ranking": [str(pair) for pair in ranking.pairs],
        "failure": None if ranking.failure is None else ranking.failure.value,
        "detail": ranking.detail,
        "warnings": list(ranking.warnings),
        "reasoning": ranking.reasoning,
        "answer": ranking.answer,
        "verdicts": {str(pair): status.value for pair, status in judged.status.items()},
        "verified": [str(pair) for pair in ALL_PAIRS if pair in judged.verified],
        "nothing_verified": judged.because,
        "rank_s": ranked - begin,
        "predict_s": judged.predict_s,
        "verify_s": verified - ranked,
        "exhaustive_s": judged.exhaustive_s,
    }


@lru_cache(maxsize=64)
def _ranker(spec: str, base_url: str | None, deadline: float) -> Ranker:
    """Made once in each process."""
    return create(spec, base_url=base_url, deadline=deadline)


def _empty(path: Path, setup: Setup, choice: Choice, error: str | None) -> dict[str, Any]:
    return {
        "run": setup.name,
        "ranker": setup.ranker,
        "command": setup.command,
        "rule_prompt": setup.rule_prompt,
        "horizon": setup.horizon,
        "scenario_id": path.stem,
        "file": str(path),
        "ego_id": None,
        "kind": None,
        "step": None,
        "dt": None,
        "label_horizon": choice.horizon,
        "labeler": choice.labeler,
        "label_lon": UNKNOWN,
        "label_lat": UNKNOWN,
        "reason": None,
        "ranking": [],
        "failure": None,
        "verdicts": {},
        "verified": [],
        "nothing_verified": None,
        "error": error,
    }


def broken(
    path: Path, setups: Sequence[Setup], choice: Choice, error: str
) -> dict[str, list[dict[str, Any]]]:
    """The rows of a file at which the work itself broke."""
    return {setup.name: [_empty(path, setup, choice, error)] for setup in setups}
