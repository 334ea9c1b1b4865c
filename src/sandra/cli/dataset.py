"""`sandra dataset`: recordings, prompts with labels, files for trainers."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

from sandra.cli.options import add_workers, command, settings_of, workers_of
from sandra.cli.output import print_json, progress
from sandra.errors import SandraError

T = TypeVar("T")


def add(commands: Any) -> None:
    parser = command(
        commands,
        "dataset",
        "make data to learn from: record traffic, label it, write it for trainers",
        "sandra dataset record --out data --episodes 100; sandra dataset build data --out "
        "data.jsonl; sandra dataset export data.jsonl --format openai --out train.jsonl",
    )
    actions = parser.add_subparsers(dest="action", metavar="ACTION", required=True)
    _add_record(actions)
    _add_build(actions)
    _add_export(actions)


def _add_record(actions: Any) -> None:
    parser = command(
        actions,
        "record",
        "record highway-env's traffic as CommonRoad scenarios, split into train, validation and "
        "test by seed, with a data card; goes on where it stopped; exit status 1 if an episode "
        "broke off with an error",
        "sandra dataset record --out data --environments highway,merge --densities 1,2 --lanes 3,4 "
        "--drivers mixed --episodes 200 --workers auto",
        "on a Dask cluster: sandra dataset record --out data --scheduler tcp://HOST:8786",
    )
    parser.add_argument("--out", required=True, metavar="DIR", help="a new folder, or one begun")
    parser.add_argument(
        "--environments",
        default="highway,merge,roundabout,intersection",
        metavar="LIST",
        help="in turn, of: highway, merge, roundabout, intersection",
    )
    parser.add_argument(
        "--densities",
        default="0.75,1,1.5,2",
        metavar="LIST",
        help="of the traffic: 1 is 24 vehicles on the highway (closer together where it is more), "
        "10 at the merge and the intersection, 5 in the roundabout",
    )
    parser.add_argument(
        "--lanes", default="2,3,4", metavar="LIST", help="per direction (intersection: always 1)"
    )
    parser.add_argument(
        "--drivers",
        default="idm,aggressive,defensive,mixed",
        metavar="LIST",
        help="highway-env's kinds of vehicles; mixed: each vehicle one of the three",
    )
    parser.add_argument("--episodes", type=int, default=100, metavar="N", help="how many in all")
    parser.add_argument("--seed", type=int, default=0, metavar="S", help="of the first episode")
    parser.add_argument("--duration", type=float, default=12.0, metavar="S", help="of each [s]")
    parser.add_argument(
        "--warm-up", type=float, default=2.0, metavar="S", help="driven before recording [s]"
    )
    add_workers(parser)
    parser.add_argument("--json", action="store_true", help="print the card as one JSON object")
    parser.set_defaults(run=_record)


def _record(arguments: argparse.Namespace) -> int:
    from sandra.evaluation.dataset.folder import DataFolder
    from sandra.learn.episodes import Recipe

    recipe = Recipe(
        environments=_list("environments", arguments.environments, str),
        densities=_list("densities", arguments.densities, float),
        lanes=_list("lanes", arguments.lanes, int),
        drivers=_list("drivers", arguments.drivers, str),
        seed=arguments.seed,
        duration=arguments.duration,
        warm_up=arguments.warm_up,
    )
    card = DataFolder(Path(arguments.out)).record(
        recipe,
        arguments.episodes,
        workers_of(arguments),
        ["sandra", *sys.argv[1:]],
        lambda done, total, name: progress(bar(done, total, name)),
    )
    progress("")
    _print(card, arguments.json)
    return 1 if card.errors else 0


def _add_build(actions: Any) -> None:
    parser = command(
        actions,
        "build",
        "turn a folder of CommonRoad scenarios into rows of prompt and ranking, what was driven "
        "first; what has no label is a row that says why; with a card beside it; an interrupted "
        "build goes on; exit status 1 if no row has a label",
        "sandra dataset build data --out data.jsonl --labeler mean --windows 3 --balance",
        "on a Dask cluster: sandra dataset build data --out data.jsonl --scheduler tcp://HOST:8786",
    )
    parser.add_argument("folder", metavar="DIR", help="of 'sandra dataset record', or any other")
    parser.add_argument("--out", required=True, metavar="FILE.jsonl", help="what is written")
    parser.add_argument(
        "--labeler",
        choices=("mean", "strict", "area"),
        default="mean",
        help="mean acceleration and lane at the end, or the formulas of the actions, or the "
        "largest reachable set",
    )
    parser.add_argument("--horizon", type=int, metavar="H", help="steps of a window (default: 25)")
    parser.add_argument(
        "--windows", type=int, default=3, metavar="N", help="per vehicle, spread evenly"
    )
    parser.add_argument(
        "--vehicles", type=int, default=0, metavar="N", help="per scenario at most; 0: all"
    )
    parser.add_argument(
        "--balance",
        nargs="?",
        type=int,
        const=0,
        metavar="N",
        help="at most N rows for each label in each split; without N: the median of the labels'",
    )
    parser.add_argument("--k", type=int, metavar="K", help="number of ranked pairs (default: 3)")
    parser.add_argument(
        "--seed", type=int, default=0, metavar="S", help="of all that is chosen at random"
    )
    parser.add_argument(
        "--variety",
        type=float,
        default=0.0,
        metavar="P",
        help="chance that a prompt tells what a recording does not hold, each by itself: a wish "
        "that fits what was driven, past pairs by chance, the rules, and that only some pairs "
        "may be ranked",
    )
    parser.add_argument(
        "--bare",
        type=float,
        default=0.0,
        metavar="P",
        help="chance that a prompt tells no accelerations and steering (all 0, as in many "
        "converted recordings), and that it tells neither the road's type nor its limits, each",
    )
    parser.add_argument("--settings", metavar="FILE", help="a TOML file with parameters")
    add_workers(parser)
    parser.add_argument("--json", action="store_true", help="print the card as one JSON object")
    parser.set_defaults(run=_build)


def _build(arguments: argparse.Namespace) -> int:
    from sandra.evaluation.dataset.build import build
    from sandra.learn.windows import Windows

    settings = settings_of(arguments)
    changes = {"horizon": arguments.horizon, "k": arguments.k}
    settings = settings.replace(**{k: v for k, v in changes.items() if v is not None})
    if arguments.balance is not None and arguments.balance < 0:
        raise SandraError(f"--balance {arguments.balance}: at least 1, or no number")
    built = build(
        Path(arguments.folder),
        Path(arguments.out),
        Windows(
            labeler=arguments.labeler,
            per_vehicle=arguments.windows,
            vehicles=arguments.vehicles,
            seed=arguments.seed,
            variety=arguments.variety,
            bare=arguments.bare,
            settings=settings,
        ),
        arguments.balance,
        workers_of(arguments),
        ["sandra", *sys.argv[1:]],
        lambda done, total, name: progress(bar(done, total, name)),
    )
    progress("")
    _print(built.card, arguments.json)
    return 0 if built.labelled else 1


def _add_export(actions: Any) -> None:
    parser = command(
        actions,
        "export",
        "write labelled rows for a trainer: OpenAI's chat format, or prompt and completion for "
        "TRL; tokens are estimated",
        "sandra dataset export data.jsonl --format openai --split train --out train.jsonl",
    )
    parser.add_argument("rows", metavar="FILE.jsonl", help="of 'sandra dataset build'")
    parser.add_argument("--format", required=True, choices=("openai", "trl"), help="for whom")
    parser.add_argument("--out", required=True, metavar="FILE", help="what is written, .jsonl")
    parser.add_argument(
        "--split", choices=("train", "validation", "test", "all"), default="train", help="of these"
    )
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    parser.set_defaults(run=_export)


def _export(arguments: argparse.Namespace) -> int:
    from sandra.learn.export import export
    from sandra.learn.rows import read_rows

    rows = read_rows(Path(arguments.rows))
    done = export(rows, arguments.format, Path(arguments.out), arguments.split)
    if arguments.json:
        print_json(done.to_dict())
    else:
        print(done)
    return 0


def bar(done: int, total: int, name: str) -> str:
    """A progress bar in one line."""
    filled = 20 * done // max(total, 1)
    return f"[{'#' * filled}{'.' * (20 - filled)}] {done} of {total}: {name}"


def _print(card: Any, as_json: bool) -> None:
    if as_json:
        print_json(card.to_dict())
    else:
        print(card, end="")


def _list(option: str, text: str, kind: Callable[[str], T]) -> tuple[T, ...]:
    words = [word.strip() for word in text.split(",") if word.strip()]
    try:
        return tuple(dict.fromkeys(kind(word) for word in words))
    except ValueError:
        raise SandraError(f"--{option} {text}: numbers, commas between") from None
