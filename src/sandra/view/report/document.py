"""What a page shows, as plain data: one JSON object, described here and in docs/report.md.

Places are in view coordinates: the ego of the first decision is at the origin, its lane points to
the right. Packed fields are text as `sandra.view.report.packing` writes it: FRAMES are one list of
polylines or rings for each step, STATES rows of x, y, heading, speed, acceleration.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields, is_dataclass
from typing import Any

FORMAT = "sandra-report"
VERSION = 1
"""Grows when a page of this version could no longer read a document."""


@dataclass(frozen=True, slots=True)
class Lane:
    """A lanelet; `kind`: "lane", "current" (the ego's) or "other" (not for cars)."""

    id: int
    kind: str
    borders: str
    """FRAMES, a single one: the left border, the right one."""


@dataclass(frozen=True, slots=True)
class Mark:
    """A light or a sign at a place [m]; `state` is a light's."""

    x: float
    y: float
    text: str
    state: str | None = None


@dataclass(frozen=True, slots=True)
class Map:
    """The road around one decision or several."""

    lanes: tuple[Lane, ...]
    goal: str | None
    """FRAMES, a single one."""


@dataclass(frozen=True, slots=True)
class Other:
    """Another road user or thing, as it is predicted."""

    id: int
    kind: str
    outline: str
    """FRAMES, a single ring about its own centre."""
    still: bool
    states: str
    """STATES, one row per step from now on: the most likely course."""
    occupancy: str | None
    """FRAMES, one per step: where its body may be then; None of those far away."""
    dropped: tuple[str, ...]
    """Assumptions that it had already broken."""


@dataclass(frozen=True, slots=True)
class Part:
    """One conjunct of a specification."""

    name: str
    text: str
    values: str
    """The same with the values of its parameters."""
    words: str


@dataclass(frozen=True, slots=True)
class Pair:
    """An action pair, what was found of it, and why."""

    pair: str
    rank: int | None
    """From 1 on; None: was not ranked."""
    asked: bool
    """Whether the decision had it verified; if not, it was verified for the page alone."""
    status: str
    empty_step: int | None
    reason: str | None
    executed: bool
    duration_s: float
    parts: tuple[str, ...]
    """Names of the conjuncts of its specification, to be looked up in `Decided.parts`."""
    sets: str
    """FRAMES, one per step: all places of the ego's centre."""
    areas: tuple[float, ...]
    """Of them [m^2]."""
    corridor: str | None
    """FRAMES: the part of them from which the horizon can be reached."""
    contested: str | None
    """FRAMES, a single one: where the set would have been at the first empty step."""
    blocking: tuple[int, ...]
    """Ids of those in its way then."""
    proven: str | None
    """What the checker of the certificate said."""


@dataclass(frozen=True, slots=True)
class Curve:
    """A trajectory of the ego; `kind`: "planned", "planned on" (after the next decision) or
    "fail-safe". `start`, `dt` and `end` in s from the decision."""

    kind: str
    start: float
    dt: float
    end: float
    states: str
    """STATES; the last row is at `end`."""


@dataclass(frozen=True, slots=True)
class Prompt:
    """What the ranker was told, and the schema of its answer as text."""

    system: int
    """Index into the document's texts; so is `schema`."""
    user: str
    schema: int
    picture: str | None
    """A data URL."""


@dataclass(frozen=True, slots=True)
class Answer:
    """What the ranker said, and what became of it."""

    ranker: str
    told: str
    """What kind of ranker that is, in words."""
    ranking: tuple[str, ...]
    answer: str | None
    reasoning: str | None
    failure: str | None
    detail: str | None
    warnings: tuple[str, ...]
    usage: Mapping[str, Any] | None
    cached: bool


@dataclass(frozen=True, slots=True)
class Decided:
    """One decision: the heart of a page. `time` is that of the decision [s]."""

    step: int
    time: float
    scenario: str
    dt: float
    horizon: int
    map: int
    """Index into the document's maps."""
    focus: tuple[float, float, float, float]
    """(x_low, x_high, y_low, y_high) of what matters [m]."""
    ego: Mapping[str, float]
    """id, length, width, x, y, heading, speed, acceleration."""
    others: tuple[Other, ...]
    marks: tuple[Mark, ...]
    parts: Mapping[str, Part]
    """By name."""
    pairs: tuple[Pair, ...]
    curves: tuple[Curve, ...]
    executed: Mapping[str, str | None]
    """kind, pair, note."""
    settings: Mapping[str, Any]
    """prediction, rules, accept, mode, command, notes, and limits that charts show."""
    prompt: Prompt
    answer: Answer
    durations_s: Mapping[str, float]
    operation: str | None = None
    """By what the ego was driven; only in an episode."""
    covered: bool | None = None


@dataclass(frozen=True, slots=True)
class Track:
    """Where somebody was: STATES from tick `first` on."""

    id: int
    kind: str
    outline: str
    first: int
    states: str


@dataclass(frozen=True, slots=True)
class Series:
    """A curve over time; None where nothing is known. `broken`: steps at which a rule is."""

    name: str
    unit: str
    dt: float
    values: tuple[float | None, ...]
    broken: tuple[int, ...] = ()


@dataclass(frozen=True, slots=True)
class Episode:
    """What happened: everybody's way, tick by tick [s], and what was measured on it."""

    ego: int
    dt: float
    ticks: int
    decided_every: int
    """Ticks from one decision to the next."""
    tracks: tuple[Track, ...]
    rules: tuple[Series, ...]
    crash: int | None
    """Tick of the ego's collision."""
    told: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Cell:
    """A cell of a table, perhaps with a link."""

    text: str
    href: str | None = None


@dataclass(frozen=True, slots=True)
class Row:
    """A row of a table, with the pages of the episodes behind it."""

    cells: tuple[str, ...]
    links: tuple[Cell, ...] = ()


@dataclass(frozen=True, slots=True)
class Table:
    """A table with a sentence about it."""

    name: str
    title: str
    headers: tuple[str, ...]
    rows: tuple[Row, ...]


@dataclass(frozen=True, slots=True)
class Bar:
    """One bar of a chart: value, and the interval around it if it has one."""

    name: str
    values: tuple[tuple[str, float, float | None, float | None], ...]
    """(what, value, low, high)."""


@dataclass(frozen=True, slots=True)
class Chart:
    """Bars in groups (`kind` "bars") or shares that add up (`kind` "shares")."""

    name: str
    title: str
    kind: str
    unit: str
    bars: tuple[Bar, ...]


@dataclass(frozen=True, slots=True)
class Document:
    """Everything on a page. `kind`: "decision", "episode" or "evaluation"."""

    kind: str
    title: str
    facts: tuple[tuple[str, str], ...]
    """What is told at the top: (name, value)."""
    maps: tuple[Map | Mapping[str, Any], ...] = ()
    decisions: tuple[Decided | Mapping[str, Any], ...] = ()
    """As objects, or as a file already holds them."""
    texts: tuple[str, ...] = ()
    """What many decisions share."""
    episode: Episode | None = None
    tables: tuple[Table, ...] = ()
    charts: tuple[Chart, ...] = ()
    home: str | None = None
    """A link back to the page that this one belongs to."""
    notes: tuple[str, ...] = ()
    """What a reader must know, such as that sets are missing."""

    def to_dict(self) -> dict[str, Any]:
        """For JSON."""
        from sandra import __version__

        head = {"format": FORMAT, "version": VERSION, "sandra": __version__}
        told = plain(self)
        assert isinstance(told, dict)
        return head | told


def plain(value: Any) -> Any:
    """Dataclasses as objects, tuples as lists, numbers that JSON lacks as null."""
    if isinstance(value, float):
        return value if value - value == 0.0 else None
    if value is None or isinstance(value, str | int):
        return value
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    if is_dataclass(value):
        return {x.name: plain(getattr(value, x.name)) for x in fields(value)}
    return plain(value.item())  # a number of numpy's
