"""Recorded rankings and verdicts, as CSV.

Rankings: one row per run and scenario. Columns `label_lon`, `label_lat` (empty or "unknown": no
label is known), `lon1`, `lat1`, `lon2`, `lat2`, ... (empty from where the ranking ends); and where
there are any `run`, `scenario_id`, `command`, `safe_top1`, `safe_top2`, `safe_top3` (0, 1, empty:
not known), `duplicate` (1: left out), `timeout_fallback` (1: the ranking stood in for a late
answer), `failure`, and durations `..._s`. Verdicts: `scenario_id`, `lon`, `lat`, `safe`.
"""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from sandra.actions import ActionPair
from sandra.errors import ActionError, SandraError
from sandra.evaluation.open_loop.baselines import safe_of
from sandra.evaluation.open_loop.scores import KS, UNKNOWN, Case

NO_COMMAND = ("", "none")
_FLAGS: dict[str, bool | None] = {"1": True, "0": False, "true": True, "false": False, "": None}
_Row = Mapping[str, str]


@dataclass(frozen=True, slots=True)
class Recorded:
    """One run of a file: its cases, rows that were left out, and the driver's command."""

    cases: tuple[Case, ...]
    repeated: int
    command: str | None


@dataclass
class _Run:
    cases: dict[str, Case] = field(default_factory=dict)
    repeated: int = 0
    commands: set[str] = field(default_factory=set)


def read_rankings(
    path: Path, verdicts: Mapping[str, Mapping[ActionPair, bool]] | None = None
) -> dict[str, Recorded]:
    """The runs of a file, in its order.

    Of several rows of a run about one scenario the first counts that is not marked `duplicate`.

    Args:
        verdicts: tell what is verified where the file has no column that says so.

    Raises:
        SandraError: names file, line and column of what cannot be used.
    """
    header, rows = _table(path, ("label_lon", "label_lat", "lon1", "lat1"))
    places = [n for n in range(1, 13) if f"lon{n}" in header and f"lat{n}" in header]
    times = [name for name in header if name.endswith("_s")]
    runs: dict[str, _Run] = {}
    for line, row in rows:
        name = row.get("run") or path.stem
        run = runs.setdefault(name, _Run())
        scenario = row.get("scenario_id") or f"{name}, line {line}"
        where = f"{path}, line {line}"
        if _flag(row, "duplicate", where) or scenario in run.cases:
            run.repeated += 1
            continue
        label = _label(row, where)
        ranking = _ranking(row, places, where)
        safe = _safe(row, safe_of(ranking, (verdicts or {}).get(scenario)), where)
        late = _flag(row, "timeout_fallback", where)
        failure = row.get("failure") or ("late" if late else None if ranking else "no ranking")
        seconds = {time: _seconds(row, time, where) for time in times if row[time]}
        run.cases[scenario] = Case(scenario, label, ranking, safe, failure, seconds)
        run.commands.add(row.get("command", ""))
    if not runs:
        raise SandraError(f"{path}: holds no row below its header; give recorded rankings")
    return {
        name: Recorded(
            tuple(run.cases.values()),
            run.repeated,
            next((c for c in sorted(run.commands) if c.lower() not in NO_COMMAND), None),
        )
        for name, run in runs.items()
    }


def read_verdicts(path: Path) -> dict[str, dict[ActionPair, bool]]:
    """By scenario and pair, whether it is verified.

    Raises:
        SandraError: names file, line and column of what cannot be used, or contradicts itself.
    """
    _, rows = _table(path, ("scenario_id", "lon", "lat", "safe"))
    found: dict[str, dict[ActionPair, bool]] = {}
    for line, row in rows:
        where = f"{path}, line {line}"
        pair = _pair(row["lon"], row["lat"], where, "lon, lat")
        safe = _flag(row, "safe", where)
        if safe is None:
            raise SandraError(f"{where}, column safe: is empty; write 1 or 0")
        if found.setdefault(row["scenario_id"], {}).setdefault(pair, safe) != safe:
            raise SandraError(f"{where}, column safe: another line says the opposite of {pair}")
    return found


def labels_of(path: Path, runs: Mapping[str, Recorded]) -> dict[str, ActionPair | None]:
    """The label of each scenario.

    Raises:
        SandraError: if two runs name different ones.
    """
    labels: dict[str, ActionPair | None] = {}
    for name, run in runs.items():
        for case in run.cases:
            if labels.setdefault(case.scenario, case.label) != case.label:
                raise SandraError(
                    f"{path}, columns label_lon, label_lat: run {name} labels {case.scenario} "
                    f"{case.label or UNKNOWN}, a run before it {labels[case.scenario] or UNKNOWN}"
                )
    return labels


def _table(path: Path, needed: tuple[str, ...]) -> tuple[list[str], Iterator[tuple[int, _Row]]]:
    try:
        text = path.read_text(encoding="utf-8-sig")
    except OSError as error:
        raise SandraError(f"{path}: cannot be read ({error.strerror}); check the path") from None
    except UnicodeDecodeError:
        raise SandraError(f"{path}: is no text file; give a CSV file") from None
    reader = csv.DictReader(io.StringIO(text, newline=""), strict=True)
    try:
        header = list(reader.fieldnames or ())
    except csv.Error as error:
        raise SandraError(f"{path}, line 1: is no CSV ({error})") from None
    for column in needed:
        if column not in header:
            raise SandraError(
                f"{path}, line 1: there is no column {column}; needed are {', '.join(needed)}"
            )
    for column in header:
        if header.count(column) > 1:
            raise SandraError(f"{path}, line 1, column {column}: is there twice; remove one")
    return header, _rows(path, reader)


def _rows(path: Path, reader: csv.DictReader[str]) -> Iterator[tuple[int, _Row]]:
    try:
        for row in reader:
            where = f"{path}, line {reader.line_num}"
            if None in row:
                raise SandraError(f"{where}: has more cells than the header has columns")
            for column, cell in row.items():
                if cell is None:
                    raise SandraError(f"{where}, column {column}: the line ends before it")
            yield reader.line_num, {name: cell.strip() for name, cell in row.items()}
    except csv.Error as error:
        raise SandraError(f"{path}, line {reader.line_num}: is no CSV ({error})") from None


def _label(row: _Row, where: str) -> ActionPair | None:
    lon, lat = row["label_lon"], row["label_lat"]
    if {lon.lower(), lat.lower()} & {"", UNKNOWN}:
        return None
    return _pair(lon, lat, where, "label_lon, label_lat")


def _ranking(row: _Row, places: list[int], where: str) -> tuple[ActionPair, ...]:
    found: list[ActionPair] = []
    for n in places:
        lon, lat = row[f"lon{n}"], row[f"lat{n}"]
        if not lon and not lat:
            continue
        found.append(_pair(lon, lat, where, f"lon{n}, lat{n}"))
    return tuple(found)


def _safe(row: _Row, known: tuple[bool | None, ...], where: str) -> tuple[bool | None, ...]:
    """What the row says, else what follows from it, else what is known from verdicts."""
    told = [_flag(row, f"safe_top{k}", where) for k in KS]
    found: list[bool | None] = []
    for i, k in enumerate(KS):
        if True in told[: i + 1]:
            if told[i] is False:
                raise SandraError(f"{where}, column safe_top{k}: is 0 though one before it is 1")
            found.append(True)
        else:
            found.append(False if False in told[i:] else known[i])
    return tuple(found)


def _pair(lon: str, lat: str, where: str, columns: str) -> ActionPair:
    try:
        return ActionPair.of(lon, lat)
    except ActionError as error:
        raise SandraError(f"{where}, columns {columns}: {error}") from None


def _flag(row: _Row, column: str, where: str) -> bool | None:
    text = row.get(column, "").lower()
    if text not in _FLAGS:
        raise SandraError(f"{where}, column {column}: '{text}' is neither 1 nor 0")
    return _FLAGS[text]


def _seconds(row: _Row, column: str, where: str) -> float:
    try:
        value = float(row[column])
    except ValueError:
        value = math.nan
    if not 0.0 <= value < math.inf:
        raise SandraError(f"{where}, column {column}: '{row[column]}' is no duration in seconds")
    return value
