"""What was measured, as data and as text."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from statistics import median
from typing import Any

RATIOS = (("free", 20.0), ("every", 4.0), ("prepare", 5.0))
"""Ratios to the peer, and what is aimed at."""
AREAS = (("matched", "largest", 1.05), ("finer", "finer", 1.01), ("seen", "seen", 1.05))
"""Ratios of areas, where `Closeness` has them, and what they should be at most."""


@dataclass(frozen=True, slots=True)
class Tight:
    """Ours with the precision "tight"; as `Ours`."""

    free: float
    every: float
    areas: tuple[float, ...]
    sets: int


@dataclass(frozen=True, slots=True)
class Ours:
    """Medians, process CPU [s]; `areas` per step [m^2], `sets` base sets over all steps.

    `ground` is all that the sets need of scene and prediction; `forbidden` the part of it that
    finds cells in which the ego would collide or leave the road.
    """

    predict: float
    ground: float
    forbidden: float
    free: float
    pair: float
    every: float
    areas: tuple[float, ...]
    sets: int
    tight: Tight


@dataclass(frozen=True, slots=True)
class Peers:
    """The peer at its default resolution; as `Ours`. `frame`: its coordinate system [s]."""

    frame: float
    prepare: float
    free: float
    areas: tuple[float, ...]
    sets: int


@dataclass(frozen=True, slots=True)
class Closeness:
    """Our area beside the peer's on the same forbidden cells, for one of our precisions.

    Attributes:
        largest, smallest: our area over the peer's at matched resolution, extremes over the steps.
        finer: the largest such ratio for our set on cells of a quarter of the size, both ways.
        seen: the largest ratio to what the matched set covers or trajectories visit.
    """

    largest: float
    smallest: float
    finer: float
    seen: float

    def __str__(self) -> str:
        return ", ".join(f"{ratio:.3f}" for ratio in (self.largest, self.finer, self.seen))


@dataclass(frozen=True, slots=True)
class Checks:
    """What was found when the two problems were compared.

    Attributes:
        obstacles: share of our forbidden cells that the peer forbids.
        matched: areas of the peer's core per step on our cells, at our resolution [m^2].
        matched_time: what that took, once [s].
        lost: the share of positions on trajectories that are not in the matched set; ours have all.
        quick, tight: our areas beside them.
    """

    obstacles: float
    matched: tuple[float, ...]
    matched_time: float
    lost: float
    quick: Closeness
    tight: Closeness


@dataclass(frozen=True, slots=True)
class Row:
    """One scenario at one horizon.

    `refused` says why it was not timed against the peer, `note` what was changed for the peer's
    sake.
    """

    scenario: str
    horizon: int
    dt: float
    obstacles: int
    pair: str
    runs: int
    ours: Ours | None = None
    peer: Peers | None = None
    checks: Checks | None = None
    refused: str | None = None
    note: str = ""

    @property
    def ratios(self) -> dict[str, float]:
        """The peer's time over ours: its one free set over our free set and over all our pairs,
        and its preparation over ours; empty where one is missing."""
        if self.ours is None or self.peer is None:
            return {}
        return {
            "free": self.peer.free / self.ours.free,
            "every": self.peer.free / self.ours.every,
            "prepare": self.peer.prepare / self.ours.forbidden,
        }

    def to_dict(self) -> dict[str, Any]:
        """For `sandra bench reach --json`."""
        return {**asdict(self), "ratios": self.ratios}


@dataclass(frozen=True, slots=True)
class Report:
    """All rows; `versions` of the peer's packages, empty without it; our kernel."""

    rows: tuple[Row, ...]
    versions: dict[str, str]
    kernel: str

    def medians(self, horizon: int | None = None) -> dict[str, float]:
        """Median ratios over the rows of one horizon, or of all."""
        rows = [row.ratios for row in self.rows if horizon in (None, row.horizon) and row.ratios]
        return {name: median(row[name] for row in rows) for name, _ in RATIOS} if rows else {}

    def closeness(self) -> dict[str, dict[str, dict[str, float]]]:
        """Of each of our precisions and of each ratio of areas: median, worst, rows within."""
        checked = [row.checks for row in self.rows if row.checks is not None]
        found: dict[str, dict[str, dict[str, float]]] = {}
        for precision in ("quick", "tight") if checked else ():
            found[precision] = {}
            for name, attribute, most in AREAS:
                ratios = [getattr(getattr(each, precision), attribute) for each in checked]
                # As they are printed: 21 rows of cells beside 20 are 1.05, up to a rounding.
                within = sum(round(ratio, 3) <= most for ratio in ratios)
                found[precision][name] = {
                    "median": median(ratios),
                    "worst": max(ratios),
                    "within": within,
                }
        return found

    def to_dict(self) -> dict[str, Any]:
        """For `sandra bench reach --json`."""
        horizons = sorted({row.horizon for row in self.rows})
        return {
            "versions": self.versions,
            "kernel": self.kernel,
            "rows": [row.to_dict() for row in self.rows],
            "areas": self.closeness(),
            "medians": {
                "all": self.medians(),
                **{str(h): self.medians(h) for h in horizons},
            },
        }

    def __str__(self) -> str:
        lines = [
            f"our kernel: {self.kernel}",
            _HEAD,
            *(line for row in self.rows for line in _lines(row)),
        ]
        horizons = sorted({row.horizon for row in self.rows})
        of_horizon = [(f"h = {h}", self.medians(h)) for h in horizons]
        for name, found in (*of_horizon, ("all", self.medians())):
            if found:
                text = ", ".join(f"{_NAMES[key]} {found[key]:.2f}" for key, _ in RATIOS)
                lines.append(f"median of {name}: {text}")
        if self.medians():
            lines.append(
                "aimed at: " + ", ".join(f"{_NAMES[key]} {goal:g}" for key, goal in RATIOS)
            )
        for precision, of_ratio in self.closeness().items():
            text = ", ".join(
                f"{name} {each['median']:.3f} in the median, {each['worst']:.3f} at most, "
                f"within {most:g} in {each['within']:.0f} rows"
                for (name, _, most), each in zip(AREAS, of_ratio.values(), strict=True)
            )
            lines.append(f"areas, {precision}: {text}")
        return "\n".join(lines)


_NAMES = {"free": "free set", "every": "all twelve", "prepare": "preparation"}
_HEAD = (
    f"{'process CPU [ms]':<34} | {'ours':^52} | {'peer':^23} | {'peer / ours':^17} | area\n"
    f"{'scenario':<28} {'h':>3}  |{'predict':>8}{'ground':>8}{'forbid':>8}{'free':>8}{'pair':>8}"
    f"{'all 12':>8}{'sets':>6}|{'check':>8}{'free':>10}{'sets':>6} |"
    f"{'free':>6}{'all 12':>7}{'fb.':>5} | matched, finer, seen"
)


def _lines(row: Row) -> list[str]:
    text = f"{row.scenario[:28]:<28} {row.horizon:>3}  |"
    if row.ours is not None:
        ours = row.ours
        times = (ours.predict, ours.ground, ours.forbidden, ours.free, ours.pair, ours.every)
        text += "".join(f"{1e3 * t:8.1f}" for t in times) + f"{ours.sets:6}|"
    if row.peer is not None:
        peer = row.peer
        text += f"{1e3 * peer.prepare:8.1f}{1e3 * peer.free:10.1f}{peer.sets:6} |"
        found = row.ratios
        text += f"{found['free']:6.1f}{found['every']:7.2f}{found['prepare']:5.1f} | "
    if row.checks is not None:
        text += str(row.checks.quick)
    lines = [text]
    if row.ours is not None:
        close = row.ours.tight
        text = f"    tight: free {1e3 * close.free:.1f}, all twelve {1e3 * close.every:.1f} ms, "
        text += f"{close.sets} sets"
        lines.append(text + (f" | area {row.checks.tight}" if row.checks else ""))
    if row.refused:
        lines.append(f"    not timed against the peer: {row.refused}")
    if row.note:
        lines.append(f"    in a frame that the peer can follow: {row.note}")
    if row.ours is not None:
        lines.append("    area [m^2] " + _areas(row))
    return lines


def _areas(row: Row) -> str:
    """The areas of every fifth step: ours, the peer's at matched and at its default resolution."""
    assert row.ours is not None
    columns: list[Sequence[float]] = [row.ours.areas]
    columns += [row.checks.matched] if row.checks else []
    columns += [row.peer.areas] if row.peer else []
    steps = [*range(5, row.horizon, 5 if row.horizon <= 25 else 10), row.horizon]
    return "  ".join(
        f"{k}: " + "/".join(f"{areas[k]:.1f}" for areas in columns if k < len(areas)) for k in steps
    )
