"""Recorded rankings, played back.

Two formats. CSV: columns `scenario_id`, `lon1`, `lat1`, `lon2`, `lat2`, ...; other columns can be
filtered on; a column `timeout_fallback` that is 1 marks a ranking that stood in for a late answer.
JSON lines: `{"scenario": "...", "ranking": [{"longitudinal": "...", "lateral": "..."}, ...]}`.
"""

from __future__ import annotations

import csv
import io
import json
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any

from sandra.actions import ActionPair
from sandra.describe.types import Prompt
from sandra.errors import ActionError, RankerError
from sandra.rankers.answer import select
from sandra.rankers.types import Failure, Ranking

_KINDS = ("run", "model", "command", "rule_prompt")
"""Columns that say under which conditions a row was recorded: one condition per replay."""


@dataclass(frozen=True, slots=True)
class Recorded:
    """One recorded ranking. `late`: it stood in for an answer that came too late."""

    pairs: tuple[ActionPair, ...]
    late: bool = False
    repeated: int = 1
    """How often the scenario is recorded; the last one counts."""


@dataclass(frozen=True, slots=True)
class ReplayRanker:
    """Looks the scenario's name up in a recording; see `load`."""

    name: str
    recorded: Mapping[str, Recorded]

    def rank(self, prompt: Prompt, deadline: float | None = None) -> Ranking:
        """See `Ranker`. A ranking that was recorded as late carries the failure TIMEOUT."""
        scenario = prompt.situation.scenario
        record = self.recorded.get(scenario)
        if record is None:
            detail = f"{self.name} holds no ranking of '{scenario}'"
            return Ranking((), self.name, Failure.NOT_RECORDED, detail)
        pairs, warnings = select(record.pairs, prompt)
        if record.repeated > 1:
            warnings = (*warnings, f"recorded {record.repeated} times, the last one is used")
        if record.late:
            detail = "recorded as a late answer; the pairs stood in for it"
            return Ranking(pairs, self.name, Failure.TIMEOUT, detail, warnings)
        if not pairs:
            failure = Failure.INFEASIBLE if record.pairs else Failure.EMPTY
            detail = "; ".join(warnings[:3]) or "the recorded ranking is empty"
            return Ranking((), self.name, failure, detail, warnings)
        return Ranking(pairs, self.name, warnings=warnings)


def load(spec: str) -> ReplayRanker:
    """Read a recording.

    Args:
        spec: `FILE`, or `FILE#column=value` (several joined by `&`) where the file holds rankings
            of several runs, models or commands, e.g. `rankings.csv#run=ft`.

    Raises:
        RankerError: if the file cannot be read, is in neither format, or its rows were recorded
            under several conditions and the filter leaves more than one.
    """
    name, conditions = _split(spec)
    try:
        text = Path(name).read_text(encoding="utf-8-sig")
    except OSError as error:
        raise RankerError(
            f"replay: {name} cannot be read ({error.strerror}); check the path"
        ) from None
    except UnicodeDecodeError:
        raise RankerError(f"replay: {name} is not a text file; give a CSV or JSONL file") from None
    rows = _json_lines(text, name) if text.lstrip().startswith("{") else _csv_rows(text, name)
    chosen = [row for row in rows if _matches(row, conditions, name)]
    if not chosen:
        raise RankerError(f"replay: no row of {name} matches '{spec}'; check the filter after '#'")
    _require_one_condition(chosen, name)
    recorded: dict[str, Recorded] = {}
    for row in chosen:
        scenario, pairs, late = row["scenario"], row["pairs"], row["late"]
        earlier = recorded.get(scenario)
        repeated = 1 if earlier is None else earlier.repeated + 1
        recorded[scenario] = Recorded(pairs, late, repeated)
    return ReplayRanker(f"replay:{spec}", MappingProxyType(recorded))


def _split(spec: str) -> tuple[str, dict[str, str]]:
    if "#" not in spec or Path(spec).is_file():
        return spec, {}
    name, _, filters = spec.rpartition("#")
    conditions = {}
    for part in re.split(r"[&,]", filters):
        column, equals, value = part.partition("=")
        if not equals:
            raise RankerError(f"replay: '{part}' is no filter; write FILE#column=value")
        conditions[column.strip()] = value.strip()
    return name, conditions


def _csv_rows(text: str, name: str) -> list[dict[str, Any]]:
    reader = csv.DictReader(io.StringIO(text, newline=""))
    header = reader.fieldnames or []
    for column in ("scenario_id", "lon1", "lat1"):
        if column not in header:
            raise RankerError(
                f"replay: {name} has no column '{column}'; a CSV recording needs scenario_id, "
                f"lon1, lat1, lon2, lat2, ..."
            )
    places = [n for n in range(1, 13) if f"lon{n}" in header and f"lat{n}" in header]
    rows: list[dict[str, Any]] = []
    try:
        for row in reader:
            where = f"replay: {name}, line {reader.line_num}"
            names = [(row[f"lon{n}"], row[f"lat{n}"]) for n in places]
            pairs = tuple(_pair(lon, lat, where) for lon, lat in names if lon and lat)
            late = row.get("timeout_fallback") == "1"
            rows.append(
                {"scenario": row["scenario_id"], "pairs": pairs, "late": late, "columns": row}
            )
    except csv.Error as error:
        raise RankerError(f"replay: {name} is not a CSV file ({error})") from None
    return rows


def _json_lines(text: str, name: str) -> list[dict[str, Any]]:
    rows: list[dict[str, Any]] = []
    for number, line in enumerate(text.split("\n"), start=1):
        if not line.strip():
            continue
        where = f"replay: {name}, line {number}"
        try:
            row = json.loads(line)
            ranking = row["ranking"]
            names = [(item["longitudinal"], item["lateral"]) for item in ranking]
            scenario = str(row["scenario"])
        except (ValueError, KeyError, TypeError, RecursionError):
            raise RankerError(
                f'{where}: not of the form {{"scenario": "...", "ranking": '
                f'[{{"longitudinal": "...", "lateral": "..."}}]}}'
            ) from None
        pairs = tuple(_pair(str(lon), str(lat), where) for lon, lat in names)
        columns = {key: str(value) for key, value in row.items()}
        rows.append({"scenario": scenario, "pairs": pairs, "late": False, "columns": columns})
    return rows


def _pair(longitudinal: str, lateral: str, where: str) -> ActionPair:
    try:
        return ActionPair.of(longitudinal, lateral)
    except ActionError as error:
        raise RankerError(f"{where}: {error}") from None


def _matches(row: Mapping[str, Any], conditions: Mapping[str, str], name: str) -> bool:
    columns = row["columns"]
    for column in conditions:
        if column not in columns:
            choices = ", ".join(str(c) for c in columns)
            raise RankerError(f"replay: {name} has no column '{column}'; choose from {choices}")
    return all(columns[column] == value for column, value in conditions.items())


def _require_one_condition(rows: list[dict[str, Any]], name: str) -> None:
    for column in _KINDS:
        values = sorted({row["columns"].get(column) or "" for row in rows})
        if len(values) > 1:
            raise RankerError(
                f"replay: {name} holds several values of '{column}' ({', '.join(values)}); "
                f"choose one: replay:{name}#{column}={values[0]}"
            )
