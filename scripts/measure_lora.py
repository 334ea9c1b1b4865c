"""Does an adapter help a model in traffic that it has not seen? Held-out scenarios, several seeds.

    python scripts/measure_lora.py --model hf:runs/small/model --out runs/shifted

Records traffic that differs from what the shipped model was trained on (`SHIFTS`: densities and
lane counts beyond those of `sandra dataset record`, one kind of driver), once to tune on and once,
with other seeds, to test on; tunes one adapter for each seed of the training; ranks every test row
with the model, alone and with each adapter, by likelihood and calibrated alike. What is there is
not done again.

The interval is a paired bootstrap over scenarios, which are what was sampled: windows of one
scenario are alike. Each draw takes scenarios, and of each all its rows, before and after. Seeds of
the training are averaged. Printed beside: the most frequent labels of the rows for tuning as a
constant ranking, so that nobody takes a shifted distribution of labels for something learned.
"""

from __future__ import annotations

import argparse
import json
import shlex
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from sandra.cli import main as sandra
from sandra.evaluation.sheet import Sheet
from sandra.learn.rows import Row, read_rows
from sandra.learn.tuning.measure import measure, spread
from sandra.rankers import create

SHIFTS = {
    "roundabout": "--environments roundabout --densities 3 --lanes 2 --drivers defensive "
    "--duration 8",
    "sparse": "--environments highway --densities 0.2 --lanes 5,6 --drivers idm --duration 6",
    "dense": "--environments highway --densities 3 --lanes 5,6 --drivers aggressive --duration 8",
}
PARTS = {"tuning": 20_000, "test": 21_000}
"""Seed of the first episode."""
WINDOWS = "--horizon 15 --windows 2 --vehicles 9"
"""Options of what becomes rows."""
DRAWS = 10_000
UNTUNED, CONSTANT = "untuned", "constant: most frequent labels of the rows for tuning"


@dataclass(frozen=True)
class Answers:
    """(n,) for each row: whether the label is first, whether it is among the first three."""

    top1: NDArray[np.bool_]
    top3: NDArray[np.bool_]


def run(words: str) -> None:
    print(f"$ sandra {words}", flush=True)
    if sandra([*shlex.split(words), "--json"]) != 0:
        raise SystemExit(f"failed: sandra {words}")


def rows_in(out: Path, shift: str, part: str, episodes: int) -> list[Row]:
    """The labelled rows of one recording, made if need be."""
    file = out / f"{part}.jsonl"
    if not file.exists():
        folder, seed = out / part, PARTS[part]
        run(f"dataset record --out {folder} {SHIFTS[shift]} --episodes {episodes} --seed {seed}")
        run(f"dataset build {folder} --out {file} {WINDOWS}")
    return [row for row in read_rows(file) if row.is_labelled]


def thinned(out: Path, rows: list[Row], most: int) -> Path:
    """A file with so many rows for training, evenly, and a tenth of that for validation."""
    file = out / f"tuning-{most}.jsonl"
    parts = {"train": most, "validation": most // 10}
    chosen = [
        row
        for split, count in parts.items()
        for row in spread([row for row in rows if row.split == split], count)
    ]
    file.write_text("".join(row.line() for row in chosen), encoding="utf-8")
    return file


def ranked(out: Path, name: str, spec: str, rows: list[Row]) -> Answers:
    """What a ranker says to all rows; kept in a file."""
    file, asked = out / f"places-{name}.json", {"ranker": spec, "rows": len(rows)}
    kept = json.loads(file.read_text()) if file.exists() else {}
    if kept.get("asked") == asked:
        places = kept["places"]
    else:
        found = measure(create(spec), rows)
        if found.failures:
            raise SystemExit(f"{spec}: {found.failures} rankings failed")
        places = list(found.places)
        file.write_text(json.dumps({"asked": asked, "places": places}))
    return Answers(
        np.array([place == 1 for place in places]),
        np.array([place is not None and place <= 3 for place in places]),
    )


def constant(train: list[Row], rows: list[Row]) -> Answers:
    order = [label for label, _ in Counter(row.label for row in train).most_common(3)]
    return Answers(
        np.array([row.label == order[0] for row in rows]),
        np.array([row.label in order for row in rows]),
    )


def interval(
    difference: NDArray[np.float64], rows: list[Row], draws: int = DRAWS
) -> tuple[float, float]:
    """95 % of the mean difference per row, by drawing scenarios."""
    names = sorted({row.scenario for row in rows})
    member = np.array([names.index(row.scenario) for row in rows])
    sums = np.bincount(member, weights=difference, minlength=len(names))
    counts = np.bincount(member, minlength=len(names))
    chosen = np.random.default_rng(0).integers(len(names), size=(draws, len(names)))
    means = sums[chosen].sum(axis=1) / counts[chosen].sum(axis=1)
    low, high = np.percentile(means, [2.5, 97.5])
    return float(low), float(high)


def by_label(hits: NDArray[np.bool_], rows: list[Row]) -> float:
    """Mean over the labels that occur: each counts the same, however rare."""
    labels = np.array([row.label for row in rows])
    return float(np.mean([hits[labels == label].mean() for label in np.unique(labels)]))


def table(found: dict[str, list[Answers]], rows: list[Row]) -> Sheet:
    """One line for each ranker, adapters together; the difference is to the untuned model."""
    base = found[UNTUNED][0]
    lines = []
    for name, seeds in found.items():
        cells = [name]
        for k in ("top1", "top3"):
            hits = np.stack([getattr(answers, k) for answers in seeds])
            each = [f"{100 * row.mean():.1f}" for row in hits]
            cells.append(f"{100 * hits.mean():.1f}" + (f" ({', '.join(each)})" if each[1:] else ""))
            if k == "top1":
                mean = np.mean([by_label(row, rows) for row in hits])
                cells.append(f"{100 * mean:.1f}")
            difference = hits.mean(axis=0) - getattr(base, k)
            low, high = interval(difference, rows)
            told = f"{100 * difference.mean():+.1f} [{100 * low:+.1f}, {100 * high:+.1f}]"
            cells.append("" if name == UNTUNED else told)
        lines.append(tuple(cells))
    head = ("ranker", "Top-1 (seeds)", "Top-1, labels alike", "to untuned")
    title = "Per cent of the test rows; differences in points, with 95 % intervals."
    return Sheet(title, (*head, "Top-3 (seeds)", "to untuned"), tuple(lines))


def main(words: list[str] | None = None) -> None:
    """Of the command line."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--model", required=True, metavar="hf:FOLDER")
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--shift", choices=tuple(SHIFTS), default="roundabout")
    parser.add_argument("--seeds", type=int, default=3, help="trainings")
    parser.add_argument("--episodes", type=int, default=40, help="to tune on, and as many to test")
    parser.add_argument("--lora", default="--loss label --rate 2e-3 --epochs 2 --batch 8")
    parser.add_argument("--tuning-rows", type=int, default=400, help="at most, evenly")
    parser.add_argument("--test-rows", type=int, default=250, help="at most, evenly; 0: all")
    chosen = parser.parse_args(words)
    out = chosen.out
    out.mkdir(parents=True, exist_ok=True)
    known = rows_in(out, chosen.shift, "tuning", chosen.episodes)
    file = thinned(out, known, chosen.tuning_rows)
    train = [row for row in read_rows(file) if row.split == "train"]
    rows = rows_in(out, chosen.shift, "test", chosen.episodes)
    rows = spread(rows, chosen.test_rows)
    how = "#mode=score&calibrate=length"
    found = {
        CONSTANT: [constant(train, rows)],
        UNTUNED: [ranked(out, UNTUNED, chosen.model + how, rows)],
    }
    tuned = []
    for seed in range(chosen.seeds):
        folder = out / f"adapter-{seed}"
        if not (folder / "card.json").exists():
            run(
                f"finetune lora {file} --model {chosen.model} --out {folder} "
                f"--seed {seed} --measure 40 {chosen.lora}"
            )
        tuned.append(ranked(out, f"tuned-{seed}", f"{chosen.model}+{folder}{how}", rows))
    found[f"LoRA, {len(tuned)} seeds"] = tuned
    scenarios = len({row.scenario for row in rows})
    labels = Counter(row.label for row in rows).most_common()
    text = (
        f"{len(train)} rows to tune on; {len(rows)} rows of {scenarios} other scenarios to test. "
        f"Labels of these: {', '.join(f'{label} {n}' for label, n in labels)}.\n\n"
        f"{table(found, rows).text('markdown')}"
    )
    (out / "table.md").write_text(text + "\n", encoding="utf-8")
    print(text)


if __name__ == "__main__":
    main()
