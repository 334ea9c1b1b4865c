"""Labels: the action pair that a recorded vehicle drove (paper Sec. III-B, Sec. V).

Three ways, none of which drops anything: what fits no pair is unknown, with the reason.

* `strict`: the formulas of Tab. II, evaluated on the recorded trace. Recorded speeds are noisy, and
  "at every step" is a strong word, so that much is unknown.
* `mean`: the mean acceleration over the window against a_lim, and the lane that holds the centre of
  the body at the end: the robust variant that the paper's authors used.
* `area`: the pair whose driving corridor is largest, and the next ones: what the road and the
  others left room for, whatever was driven.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from sandra.actions import ALL_PAIRS, ActionPair, Lateral, Longitudinal
from sandra.errors import SettingsError
from sandra.learn.trace import Recorded
from sandra.logic import specification
from sandra.logic.evaluate import evaluate
from sandra.logic.formula import atoms_of
from sandra.prediction import predict
from sandra.reach import ground, verify_on
from sandra.scene.types import Scene
from sandra.settings import Settings

LABELERS = ("mean", "strict", "area")
_SIDES = {Lateral.LEFT_LANE: "left", Lateral.RIGHT_LANE: "right"}


@dataclass(frozen=True, slots=True)
class Label:
    """What was driven; `pair` is None, unknown, unless both parts are known.

    `holds` are the pairs that fit, the label first: under `strict` those whose formulas hold, under
    `area` the k with the largest corridors, under `mean` the label alone.
    """

    longitudinal: Longitudinal | None
    lateral: Lateral | None
    holds: tuple[ActionPair, ...]
    reason: str | None = None
    """Why it is unknown."""
    areas: Mapping[ActionPair, float] = field(default_factory=dict)
    """Under `area`: of the corridors, summed over the steps [m^2]."""

    @property
    def pair(self) -> ActionPair | None:
        """The label; None if it is unknown."""
        if self.longitudinal is None or self.lateral is None:
            return None
        return ActionPair(self.longitudinal, self.lateral)


def label(
    scene: Scene, horizon: int, labeler: str = "mean", settings: Settings | None = None
) -> Label:
    """The label of the recorded ego over the first `horizon` steps.

    Args:
        labeler: one of `LABELERS`. settings: a_lim, v_err; for `area` all that verdicts depend on.

    Raises:
        ScenarioError: the ego is not recorded for so long. SettingsError: an unknown labeler.
    """
    settings = settings or Settings()
    if labeler not in LABELERS:
        raise SettingsError(f"unknown labeler '{labeler}': choose from {', '.join(LABELERS)}")
    recorded = Recorded.of(scene, horizon)
    if labeler == "area":
        return _by_area(scene, horizon, settings)
    return (_strict if labeler == "strict" else _mean)(recorded, settings)


def _mean(recorded: Recorded, settings: Settings) -> Label:
    mean = recorded.mean_acceleration
    if recorded.states[-1, 3] <= settings.v_err:
        longitudinal = Longitudinal.STOP
    elif abs(mean) <= settings.a_lim:
        longitudinal = Longitudinal.KEEP
    else:
        longitudinal = Longitudinal.ACCELERATE if mean > 0.0 else Longitudinal.DECELERATE
    lateral = _lateral_of_centre(recorded)
    reason = None if lateral else "at the end the centre is in no lane that an action names"
    holds = () if lateral is None else (ActionPair(longitudinal, lateral),)
    return Label(longitudinal, lateral, holds, reason)


def _lateral_of_centre(recorded: Recorded) -> Lateral | None:
    if recorded.centre_in("current"):
        return Lateral.FOLLOW_LANE
    sides = (lateral for lateral, relation in _SIDES.items() if recorded.centre_in(relation))
    return next(sides, None)


def _strict(recorded: Recorded, settings: Settings) -> Label:
    """Where several pairs hold, stop before others, and of lanes that of the centre at the end."""
    formulas = {
        pair: specification(pair, (), settings, dt=recorded.scene.dt).formula for pair in ALL_PAIRS
    }
    letters = recorded.letters({atom for f in formulas.values() for atom in atoms_of(f)})
    holds = [pair for pair, formula in formulas.items() if evaluate(formula, letters)]
    if not holds:
        lon, lat = _parts_that_hold(settings, recorded)
        return Label(lon, lat, (), _missing(lon, lat))
    centre = _lateral_of_centre(recorded)
    holds.sort(key=lambda p: (p.longitudinal is not Longitudinal.STOP, p.lateral is not centre))
    return Label(holds[0].longitudinal, holds[0].lateral, tuple(holds))


def _parts_that_hold(
    settings: Settings, recorded: Recorded
) -> tuple[Longitudinal | None, Lateral | None]:
    """The first longitudinal and lateral action whose own formula holds."""
    found: dict[str, bool] = {}
    for pair in ALL_PAIRS:
        for part in specification(pair, (), settings, dt=recorded.scene.dt).parts:
            if part.name not in found:
                letters = recorded.letters(atoms_of(part.formula))
                found[part.name] = evaluate(part.formula, letters)
    order = (Longitudinal.STOP, *Longitudinal)
    return (
        next((action for action in order if found[action.value]), None),
        next((action for action in Lateral if found[action.value]), None),
    )


def _missing(lon: Longitudinal | None, lat: Lateral | None) -> str:
    names = [n for n, part in (("longitudinal", lon), ("lateral", lat)) if part is None]
    return f"no {' and no '.join(names)} formula holds on the trace"


def _by_area(scene: Scene, horizon: int, settings: Settings) -> Label:
    settings = settings.replace(horizon=horizon)
    base = ground(scene, predict(scene, "most-likely", horizon, settings), settings)
    sizes: dict[ActionPair, float] = {}
    for verdict in verify_on(base, ALL_PAIRS, reasons=False):
        corridor = verdict.reachable_set.corridor()
        sizes[verdict.pair] = sum(corridor.area(k) for k in range(len(corridor.steps)))
    order = sorted((p for p in ALL_PAIRS if sizes[p] > 0.0), key=lambda p: -sizes[p])
    if not order:
        return Label(None, None, (), "no pair has a corridor", sizes)
    return Label(order[0].longitudinal, order[0].lateral, tuple(order[: settings.k]), None, sizes)
