"""A named set of assumptions as TOML: what `--assumptions conformant:FILE` reads."""

from __future__ import annotations

import json
from collections.abc import Collection
from dataclasses import fields
from pathlib import Path

from sandra.errors import SettingsError
from sandra.evaluation.conformance.report import Conformance
from sandra.settings import Assumptions


def write(
    found: Conformance,
    path: str | Path,
    name: str | None = None,
    margin: float = 0.05,
    keep: Collection[str] = (),
) -> Assumptions:
    """Write the tightest bounds with their evidence; returns them.

    Args:
        name: of the set; default: the file's.
        margin, keep: see `Conformance.tightest`.

    Raises:
        SettingsError: it cannot be written, or some recordings could not be judged.
    """
    where = Path(path)
    if found.broken_files:
        file, error = found.broken_files[0]
        raise SettingsError(f"{file}: not judged ({error}); leave it out, no bounds are written")
    tightest = found.tightest(margin, keep)
    text = _text(found, tightest, name or where.stem, margin, keep)
    try:
        where.write_text(text, encoding="utf-8")
    except OSError as error:
        raise SettingsError(
            f"{where}: cannot be written ({error.strerror}); choose another place"
        ) from None
    return tightest


def _text(
    found: Conformance, tightest: Assumptions, name: str, margin: float, keep: Collection[str]
) -> str:
    lines = [
        "# The tightest bounds that no recorded vehicle breaks. Read by --assumptions",
        "# conformant:FILE, and by sandra.Assumptions.load.",
        "",
        "[conformance]",
        f"name = {json.dumps(name)}",
        f"margin = {margin!r}",
        f"towards = {json.dumps(found.towards)}",
        f"keep = {json.dumps(sorted(keep))}",
        f"vehicles = {sum(s.vehicles for s in found.sources)}",
        f"vehicle_steps = {sum(s.steps for s in found.sources)}",
        f"crashed_steps = {sum(s.crashed_steps for s in found.sources)}",
        "",
        "[assumptions]",
    ]
    evidence = {f.name: f for f in found.findings}
    for entry in fields(Assumptions):
        value = getattr(tightest, entry.name)
        words = json.dumps(value) if isinstance(value, bool) else repr(float(value))
        seen = evidence.get(entry.name)
        why = ""
        if seen is not None:
            at = "not seen" if seen.where is None else f"{seen.worst:.6g} at {seen.where}"
            why = "  # " + "".join(x if x.isprintable() else "?" for x in at)
        lines.append(f"{entry.name} = {words}{why}")
    for source in found.sources:
        lines += [
            "",
            "[[conformance.source]]",
            f"file = {json.dumps(source.file)}",
            f"sha256 = {json.dumps(source.sha256)}",
            f"vehicles = {source.vehicles}",
            f"vehicle_steps = {source.steps}",
            f"crashed_steps = {source.crashed_steps}",
        ]
    return "\n".join(lines) + "\n"
