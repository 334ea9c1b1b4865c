"""Mutation score of the safety core: does some test fail for each small change of the code?

    make mutation                          # every comparison, and 200 others of each room
    make mutation ROOM=logic               # one room
    make mutation ROOM=logic SAMPLE=all    # every mutant

Every comparison is always run. What is known from an earlier run is not run again: a killed mutant
stays killed while its file is the same and the test that killed it exists; a survivor is tried
again as soon as a test changes. Exit status 1 if a mutant survives that tests/mutation.toml does
not explain. docs/mutation.md says how to read the numbers.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import signal
import sys
import time
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path

from mutation import covering, harness, report, survivors
from mutation.mutant import COMPARISON, OTHER, Mutant
from mutation.mutants import mutants
from mutation.rooms import ROOMS, module_of, sources

ROOT = Path(__file__).resolve().parents[1]
STORE = ROOT / ".mutation"
LIST = ROOT / "tests" / "mutation.toml"


class Room:
    """One room: its mutants, its tests, and what is known so far."""

    def __init__(self, name: str, options: argparse.Namespace) -> None:
        self.name, self.options = name, options
        self.mutants = [m for path in sources(ROOT, name) for m in _made(path)]
        self.known_path = STORE / f"{name}.results.json"
        self.known: dict[str, dict[str, str]] = (
            json.loads(self.known_path.read_text()) if self.known_path.exists() else {}
        )
        helpers = [p for p in (ROOT / "tests").glob("*.py") if not p.name.startswith("test_")]
        of_room = (ROOT / "tests" / name).rglob("*.py")
        package = (ROOT / "src").rglob("*.py")
        self.tests = covering.fingerprint([*helpers, *of_room, *package])
        self.covering = self._measured()

    def _measured(self) -> covering.Covering:
        path = STORE / f"{self.name}.covering.{self.tests}.json"
        if not path.exists():
            for old in STORE.glob(f"{self.name}.covering.*.json"):
                old.unlink()
            covering.save(covering.measure(self.name, ROOMS[self.name], STORE), path)
        return covering.load(path)

    def chosen(self) -> list[Mutant]:
        """All comparisons, and a random sample of the others, within the named files."""
        named = [m for m in self.mutants if self._named(m)]
        others = sorted((m for m in named if m.kind == OTHER), key=self._draw)
        sample = self.options.sample
        keep = {m.id for m in (others if sample == "all" else others[: int(sample)])}
        return [m for m in named if m.kind == COMPARISON or m.id in keep]

    def _draw(self, mutant: Mutant) -> str:
        """A random number that stays the same when something else in the file changes."""
        return hashlib.sha256(f"{self.options.seed} {mutant.change}".encode()).hexdigest()

    def _named(self, mutant: Mutant) -> bool:
        wanted = self.options.only
        return not wanted or wanted in f"{mutant.file}:{mutant.function}"

    def status(self, mutant: Mutant) -> str | None:
        """What is known of a mutant and still true."""
        known = self.known.get(mutant.id)
        if known is None or self.options.fresh:
            return None
        if known["status"] in report.DEAD:
            by = known["by"]
            return known["status"] if "::" not in by or by in self.covering.seconds else None
        return known["status"] if known["tests"] == self.tests else None

    def jobs(self, chosen: list[Mutant]) -> Iterator[harness.Job]:
        for mutant in chosen:
            tests = self.covering.of(mutant.file, mutant.lines, self.options.budget)
            if tests:
                path = ROOT / mutant.file
                yield harness.Job(mutant.id, module_of(mutant.file), path, mutant.source, tests)
            else:
                self.note(mutant.id, harness.Outcome("not covered"))

    def note(self, key: str, outcome: harness.Outcome) -> None:
        self.known[key] = {"status": outcome.status, "by": outcome.by, "tests": self.tests}

    def save(self) -> None:
        self.known_path.write_text(json.dumps(self.known, indent=0))

    def run(self) -> list[report.Result]:
        """The chosen mutants with what became of each."""
        chosen = self.chosen()
        todo = [m for m in chosen if self.status(m) is None]
        print(f"{self.name}: {len(self.mutants)} mutants, {len(chosen)} chosen, {len(todo)} to run")
        harness.preload(self.covering.foreign)
        begin, seconds, n = time.time(), 0.0, 0
        by_id = {m.id: m for m in todo}
        done: dict[str, str] = {}
        try:
            for n, (job, outcome) in enumerate(
                harness.run_all(self.jobs(todo), self.options.workers), start=1
            ):
                if outcome.status == "broken":
                    _print_survivor(by_id[job.key], "no verdict")
                    raise SystemExit("mutation: the tests did not run; try MUTATION_DEBUG=1")
                self.note(job.key, outcome)
                done[job.key] = outcome.status
                seconds += outcome.seconds
                if outcome.status not in report.DEAD:
                    _print_survivor(by_id[job.key], outcome.status)
                if n % 50 == 0:
                    self.save()
                    print(f"  {n}/{len(todo)}  {time.time() - begin:.0f} s", flush=True)
        finally:
            self.save()
        if n:
            print(f"  {seconds / n:.2f} s of processor time per mutant")
        return [(m, done.get(m.id) or self.known[m.id]["status"]) for m in chosen]


def _made(path: Path) -> list[Mutant]:
    """The mutants of a file; making them takes a while, so they are kept."""
    key = covering.fingerprint([path, ROOT / "scripts" / "mutation" / "mutants.py"])
    kept = STORE / "mutants" / f"{path.parent.name}.{path.stem}.{key}.json"
    if not kept.exists():
        kept.parent.mkdir(parents=True, exist_ok=True)
        for old in kept.parent.glob(f"{path.parent.name}.{path.stem}.*.json"):
            old.unlink()
        kept.write_text(json.dumps([asdict(m) for m in mutants(ROOT, path)]))
    return [Mutant(**{**m, "lines": tuple(m["lines"])}) for m in json.loads(kept.read_text())]


def _print_survivor(mutant: Mutant, status: str) -> None:
    print(f"  {status}: {mutant.file}:{mutant.lines[0]} {mutant.function} [{mutant.kind}]")
    print(f"    - {mutant.before}\n    + {mutant.after}", flush=True)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("rooms", nargs="*", default=list(ROOMS), help="names of rooms")
    parser.add_argument("--sample", default="200", help="other mutants per room, or 'all'")
    parser.add_argument("--seed", type=int, default=1, help="of the sample")
    parser.add_argument("--workers", type=int, default=1, help="processes at a time")
    parser.add_argument("--budget", type=float, default=30.0, help="s of tests per mutant")
    parser.add_argument("--only", default="", help="part of 'file:function', to work on one place")
    parser.add_argument("--fresh", action="store_true", help="run everything anew")
    parser.add_argument(
        "--template", action="store_true", help="print entries for unexplained ones"
    )
    parser.add_argument("--table", type=Path, help="write the table into this document")
    options = parser.parse_args()
    os.chdir(ROOT)
    sys.path.insert(0, str(ROOT / "src"))  # this project, wherever the environment is from
    # The mutants are Python's: the native kernel would hide them from most tests.
    os.environ["SANDRA_KERNEL"] = "python"
    STORE.mkdir(exist_ok=True)
    # Stopped by `kill`, it still keeps what it knows.
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(2))

    entries = survivors.load(LIST)
    rows: list[str] = []
    unexplained: list[report.Result] = []
    used: set[survivors.Entry] = set()
    for name in options.rooms or list(ROOMS):
        room = Room(name, options)
        results = room.run()
        for kind in (COMPARISON, OTHER):
            of_kind = [(m, s) for m, s in results if m.kind == kind]
            total = sum(m.kind == kind for m in room.mutants if room._named(m))
            s = report.score(total, of_kind, entries)
            rows.append(report.row(name, report.kind_name(kind), s))
        for mutant, status in results:
            entry = survivors.explanation(mutant, entries)
            if status not in report.DEAD and entry is None:
                unexplained.append((mutant, status))
            if status not in report.DEAD and entry is not None:
                used.add(entry)
        present = {(m.file, m.function, m.before, m.after): s for m, s in results}
        for entry in entries:
            key = (entry.file, entry.function, entry.before, entry.after)
            exists = any(survivors.explanation(m, [entry]) for m in room.mutants)
            if entry.file.startswith(f"src/sandra/{name}/") and entry not in used:
                if not exists:
                    print(f"stale entry, no such mutant: {key}")
                elif present.get(key) in report.DEAD:
                    print(f"stale entry, it is killed: {key}")
    print("\n" + "\n".join([report.HEADER, *rows]))
    if options.table:
        options.table.write_text(report.with_rows(options.table.read_text("utf-8"), rows), "utf-8")
    if unexplained:
        print(f"\n{len(unexplained)} unexplained:")
        for mutant, status in unexplained:
            if options.template:
                print(survivors.template(mutant))
            else:
                _print_survivor(mutant, status)
    return 1 if unexplained else 0


if __name__ == "__main__":
    sys.exit(main())
