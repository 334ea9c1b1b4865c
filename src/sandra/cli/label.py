"""`sandra label`: which action pair recorded vehicles drove."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sandra.cli.options import add_format, add_workers, command, path_of, settings_of, workers_of
from sandra.cli.output import print_json, progress, tables_in, tell_written, write_files
from sandra.errors import SandraError

if TYPE_CHECKING:
    from sandra.evaluation.labelling import Choice, Labels


def add(commands: Any) -> None:
    parser = command(
        commands,
        "label",
        "label recorded trajectories with the action pairs that were driven: exit status 1 if a "
        "file or a window could not be used",
        "sandra label recordings/ --labeler mean --horizon 25 --stride 10 --ego all "
        "--workers auto --out runs/labels",
        "on a Dask cluster: sandra label recordings/ --ego all --scheduler tcp://HOST:8786 "
        "--out runs/labels",
    )
    add_scenarios(parser)
    parser.add_argument(
        "--labeler",
        choices=("mean", "strict", "area"),
        default="mean",
        help="mean acceleration and the lane of the centre at the end, as the paper's authors did; "
        "the formulas of the pairs on the trace; or the pairs with the largest reachable areas",
    )
    add_choice(parser)
    parser.add_argument("--settings", metavar="FILE", help="a TOML file with parameters")
    add_workers(parser)
    parser.add_argument(
        "--out",
        metavar="FOLDER",
        help="labels.csv and labels.jsonl, the distribution as .md, .tex, .csv, and what is needed "
        "to go on after a break",
    )
    add_format(parser, "of the distribution that is printed")
    parser.add_argument("--json", action="store_true", help="print one JSON object with all rows")
    parser.set_defaults(run=_label)


def add_scenarios(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "scenarios",
        metavar="SCENARIO|FOLDER",
        nargs="+",
        help="CommonRoad files, names of 'sandra scenarios', or folders with .xml files in them "
        "and below",
    )


def add_choice(
    parser: argparse.ArgumentParser, horizon: str = "--horizon", windows: int = 0
) -> None:
    """Options that say whose trajectories, and from which steps on."""
    parser.add_argument(
        horizon,
        dest="label_horizon",
        type=int,
        metavar="H",
        help="steps of a label (default: that of the settings, 25)",
    )
    parser.add_argument(
        "--stride",
        type=int,
        metavar="N",
        help="steps between windows (default: as many as a label has)",
    )
    parser.add_argument(
        "--windows",
        type=int,
        default=windows,
        metavar="N",
        help="most windows of a vehicle, 0 for all",
    )
    parser.add_argument(
        "--ego",
        default="auto",
        metavar="WHO",
        help="given (the recorded ego of the planning problem), chosen (a vehicle by --seed), "
        "auto (given, where it is recorded for long enough, else chosen), all, or an id",
    )
    parser.add_argument("--seed", type=int, default=0, metavar="N", help="of the choice")


def files_of(given: list[str]) -> list[Path]:
    """Files as they are named, and those in and below folders."""
    found: list[Path] = []
    for word in given:
        path = path_of(word)
        if not path.exists():
            raise SandraError(f"{path}: no such file; check the path")
        inside = sorted(path.rglob("*.xml")) if path.is_dir() else [path]
        if not inside:
            raise SandraError(f"{path}: there is no .xml file in this folder; name another one")
        found += inside
    return list(dict.fromkeys(found))


def choice_of(arguments: argparse.Namespace, labeler: str) -> Choice:
    from sandra.evaluation.labelling import Choice

    settings = settings_of(arguments)
    horizon = settings.horizon if arguments.label_horizon is None else arguments.label_horizon
    return Choice(
        ego=arguments.ego,
        seed=arguments.seed,
        horizon=horizon,
        stride=horizon if arguments.stride is None else arguments.stride,
        windows=arguments.windows,
        labeler=labeler,
        settings=settings,
    )


def _label(arguments: argparse.Namespace) -> int:
    from sandra.evaluation.labelling import label_all

    out = None if arguments.out is None else Path(arguments.out)
    found = label_all(
        files_of(arguments.scenarios),
        choice_of(arguments, arguments.labeler),
        journal=None if out is None else out / "journal.jsonl",
        workers=workers_of(arguments),
        progress=lambda done, total, name: progress(f"{done} of {total} files: {name}"),
    )
    progress("")
    written = [] if out is None else _write(found, out)
    if arguments.json:
        files = [str(file) for file in written]
        print_json({"summary": found.summary(), "rows": list(found.rows), "files": files})
    else:
        for sheet in found.sheets().values():
            print(sheet.text(arguments.format))
        tell_written(written)
    return 1 if found.errors else 0


def _write(found: Labels, out: Path) -> list[Path]:
    files = {out / "labels.csv": found.csv(), out / "labels.jsonl": found.jsonl()}
    files |= tables_in(out, found.sheets())
    files[out / "summary.json"] = json.dumps(found.summary(), indent=1) + "\n"
    return write_files(out, files)
