"""Criticality measures of what is in the ego's way, beside the time-to-collision.

Of the measures reviewed by Westhofen et al. (2023, "Criticality metrics for automated driving") and
collected in CommonRoad-CriMe (Lin and Althoff 2023), in the lane frame, bumper to bumper:

* distance headway: the gap [m];
* time headway: the gap over the ego's speed [s];
* brake threat number: the deceleration that the ego needs (Jansson 2005, Sec. 5.3) over the
  strongest one it has, `-Settings.a_lon_min`; from 1 on, braking alone does not suffice.

They are told of whatever is in front in the ego's lane or reaches into its path; the brake threat
number only of what does not come towards the ego, since no braking avoids that.
"""

from __future__ import annotations

import math

from sandra.describe.templates import Templates
from sandra.describe.types import ObstacleFacts
from sandra.errors import SettingsError

MEASURES = ("time-headway", "distance-headway", "brake-threat")


def measures_of(text: str) -> tuple[str, ...]:
    """Measures from a list with commas, or "all".

    Raises:
        SettingsError: an unknown name.
    """
    names = [name.strip() for name in text.split(",") if name.strip()]
    for name in names:
        if name not in (*MEASURES, "all"):
            raise SettingsError(f"measure '{name}': choose from {', '.join(MEASURES)}, or all")
    return tuple(m for m in MEASURES if m in names or "all" in names)


def required_braking(gap: float, speed: float, other: float, acceleration: float) -> float:
    """The smallest constant deceleration >= 0 by which the ego stays behind [m/s^2].

    Args:
        gap: bumper to bumper > 0 [m]. speed: of the ego [m/s].
        other: speed of what is ahead >= 0 [m/s]; it keeps its `acceleration` [m/s^2], and if that
            is negative it comes to a standstill and stays there.

    Returns:
        0 if nothing is needed; NaN if `other` is negative or something is unknown.
    """
    if not other >= 0.0 or not math.isfinite(gap + speed + acceleration):
        return math.nan
    if speed <= 0.0:
        return 0.0
    closing = speed - other
    if acceleration < 0.0:
        stops_after = other / -acceleration
    else:
        stops_after = 0.0 if other == acceleration == 0.0 else math.inf
    # Both at one speed at 2 gap / closing: as long as the other one still moves then.
    if closing > 0.0 and 2.0 * gap <= stops_after * closing:
        return max(0.0, closing**2 / (2.0 * gap) - acceleration)
    if math.isinf(stops_after):
        return 0.0
    return speed**2 / (2.0 * (gap + other * stops_after / 2.0))


def explanation(words: Templates, measures: tuple[str, ...], braking: float) -> str:
    """What the measures mean, in one line; `braking` is the strongest of the ego, > 0 [m/s^2]."""
    told = [words.say("criticality", f"{name}_means", braking=braking) for name in measures]
    return "(" + " ".join(told) + ")"


def criticality_text(
    words: Templates, o: ObstacleFacts, measures: tuple[str, ...], braking: float
) -> str:
    """The measures of one obstacle; empty if it is not in the ego's way."""
    values: dict[str, float | None] = {
        "time-headway": o.time_headway,
        "distance-headway": None if o.required_braking is None else o.gap,
        "brake-threat": None if o.required_braking is None else o.required_braking / braking,
    }
    told = []
    for name in measures:
        value = values[name]
        if value is not None and math.isfinite(value):
            told.append(words.say("criticality", name, value=value))
    return " ".join(told)
