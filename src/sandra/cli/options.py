"""Options that several commands share, and what they stand for."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sandra.errors import SandraError

if TYPE_CHECKING:
    from sandra.evaluation.workers import Workers
    from sandra.logic import Vocabulary
    from sandra.rankers.usage import Price
    from sandra.scene import Scene
    from sandra.settings import Settings


class _Help(argparse.ArgumentDefaultsHelpFormatter):
    """Defaults that say something; examples as they are, so that they can be copied."""

    def _get_help_string(self, action: argparse.Action) -> str | None:
        if action.default in (None, "", False) or "(default:" in (action.help or ""):
            return action.help
        return super()._get_help_string(action)

    def _fill_text(self, text: str, width: int, indent: str) -> str:
        if text.startswith("example:"):
            return text
        return super()._fill_text(text, width, indent)


def command(commands: Any, name: str, text: str, *examples: str) -> argparse.ArgumentParser:
    parser: argparse.ArgumentParser = commands.add_parser(
        name,
        help=text,
        description=text[0].upper() + text[1:] + ".",
        epilog="\n  ".join(["example:", *examples]),
        formatter_class=_Help,
    )
    return parser


def add_scenario(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "scenario", metavar="SCENARIO", help="a CommonRoad file, or a name of 'sandra scenarios'"
    )
    parser.add_argument(
        "--problem", type=int, metavar="ID", help="planning problem, where the file has several"
    )
    parser.add_argument("--settings", metavar="FILE", help="a TOML file with parameters")
    parser.add_argument("--json", action="store_true", help="print one JSON object")


def add_verification(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--prediction",
        default="most-likely",
        metavar="KIND",
        help="of the other traffic: most-likely, set-based, recorded or constant-velocity",
    )
    add_assumptions(parser)
    parser.add_argument(
        "--rules", default="", metavar="LIST", help="traffic rules, e.g. R_G1,R_G2,R_G3"
    )
    parser.add_argument("--horizon", type=int, metavar="H", help="steps to verify (default: 25)")
    parser.add_argument(
        "--precision",
        metavar="HOW",
        help="of reachable sets: quick, or tight for smaller ones in about twice the time "
        "(default: that of --settings)",
    )
    parser.add_argument(
        "--vocabulary", metavar="FILE", help="a TOML file with actions and rules of your own"
    )
    parser.add_argument("--figure", metavar="FILE", help="draw it: .png, .pdf or .svg")


def add_assumptions(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--assumptions",
        metavar="SET",
        help="of the set-based prediction: paper, or conformant:FILE, as 'sandra conformance' "
        "writes it (default: those of --settings)",
    )


def add_prompting(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--command", dest="wish", metavar="TEXT", help="the driver's wish")
    parser.add_argument("--k", type=int, metavar="K", help="number of ranked pairs (default: 3)")
    parser.add_argument(
        "--past", default="", metavar="PAIRS", help="pairs driven before, oldest first, ';' between"
    )
    parser.add_argument("--rule-prompt", action="store_true", help="tell the rules in the prompt")


def add_server(parser: argparse.ArgumentParser) -> None:
    """How a ranker's server is asked; see docs/rankers.md."""
    parser.add_argument("--base-url", metavar="URL", help="of an OpenAI-compatible server")
    parser.add_argument(
        "--deadline",
        type=float,
        default=30.0,
        metavar="SECONDS",
        help="for the whole ranking, retries included",
    )
    parser.add_argument(
        "--max-concurrent",
        type=int,
        metavar="N",
        help="requests to the server at once, over all processes of yours on this machine "
        "(default: 16 in each process)",
    )
    parser.add_argument(
        "--cache", metavar="FOLDER", help="keep the answers of servers there, and use them again"
    )
    parser.add_argument(
        "--prices", metavar="FILE", help="a TOML file with prices of models, for what it costs"
    )


def prices_of(arguments: argparse.Namespace) -> dict[str, Price]:
    from sandra.rankers.usage import load_prices

    return load_prices(arguments.prices) if arguments.prices else {}


def add_format(parser: argparse.ArgumentParser, of_what: str = "of what is printed") -> None:
    """Of the tables on stdout."""
    parser.add_argument(
        "--format", choices=("markdown", "latex", "csv"), default="markdown", help=of_what
    )


def add_workers(parser: argparse.ArgumentParser) -> None:
    """On how many processes of this machine, or where else, many scenarios are worked on."""
    where = parser.add_mutually_exclusive_group()
    where.add_argument(
        "--workers",
        default="1",
        metavar="N",
        help="processes, 'auto' for one on each core; the results are the same",
    )
    where.add_argument(
        "--scheduler",
        metavar="tcp://HOST:PORT",
        help="of a Dask cluster that runs already, instead of processes here (docs/cluster.md); "
        "the results are the same",
    )


def workers_of(arguments: argparse.Namespace) -> Workers:
    from sandra.evaluation.workers import ALL_CORES, Cluster

    if arguments.scheduler is not None:
        if getattr(arguments, "cache", None) is not None:
            raise SandraError(
                "--cache with --scheduler: each worker's machine would keep answers of its own; "
                "leave one of them away"
            )
        return Cluster(arguments.scheduler)
    text = arguments.workers.strip().lower()
    if text in ("auto", "0"):
        return ALL_CORES
    if not text.isdecimal():
        raise SandraError(
            f"--workers {arguments.workers}: write a number of processes, or auto for all cores"
        )
    return int(text)


def settings_of(arguments: argparse.Namespace) -> Settings:
    from sandra.settings import Assumptions, Settings

    settings = Settings.load(arguments.settings) if arguments.settings else Settings()
    chosen = getattr(arguments, "assumptions", None)
    if chosen is not None:
        settings = settings.replace(assumptions=Assumptions.named(chosen))
    precision = getattr(arguments, "precision", None)
    return settings if precision is None else settings.replace(precision=precision)


def vocabulary_of(arguments: argparse.Namespace) -> Vocabulary | None:
    if arguments.vocabulary is None:
        return None
    from sandra.logic import Vocabulary

    return Vocabulary.load(arguments.vocabulary)


def path_of(scenario: str) -> Path:
    """A file as it is named, or the scenario of ours that has this name."""
    from sandra.scenarios import examples

    given = Path(scenario)
    return given if given.exists() else examples().get(scenario, given)


def scene_of(arguments: argparse.Namespace, settings: Settings) -> Scene:
    from sandra.scene import load

    path = path_of(arguments.scenario)
    return load(path, planning_problem=arguments.problem, settings=settings)


def past_of(text: str) -> tuple[Any, ...]:
    from sandra.actions import ActionPair

    return tuple(ActionPair.parse(pair) for pair in text.split(";") if pair.strip())
