"""`sandra drive`: closed loop in highway-env."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sandra.cli.options import (
    add_assumptions,
    add_server,
    add_workers,
    command,
    prices_of,
    settings_of,
    workers_of,
)
from sandra.cli.output import print_json
from sandra.cli.prompting import add_context, prompt_options_of
from sandra.errors import SandraError

if TYPE_CHECKING:
    from sandra.evaluation.closed_loop.drive import Drive


def add(commands: Any) -> None:
    parser = command(
        commands,
        "drive",
        "drive episodes of highway-env with decisions that are verified, and write a run folder; "
        "exit status 0 if the ego was in no collision, else 1",
        "sandra drive highway --setting 2 --seeds 5838 --ranker rules --prediction set-based "
        "--rules R_G1,R_G2,R_G3",
        "sandra drive highway --ranker openai:MODEL --base-url http://localhost:8000/v1 "
        "--deadline 2 --workers 4 --max-concurrent 2 --vision ego",
    )
    parser.add_argument(
        "environment",
        nargs="?",
        default="highway",
        metavar="ENV",
        help="highway, merge, roundabout, intersection or racetrack",
    )
    parser.add_argument(
        "--setting", type=int, default=1, metavar="N", help="1 to 3 of the paper (highway)"
    )
    parser.add_argument(
        "--seeds",
        default="5838",
        metavar="LIST",
        help="seeds of the traffic, e.g. 1,2,5-9, or paper",
    )
    parser.add_argument("--profile", default="stock", metavar="NAME", help="stock or paper")
    parser.add_argument("--steps", type=int, default=30, metavar="N", help="decisions, 0.2 s each")
    parser.add_argument(
        "--ranker", default="embedded", metavar="NAME", help="as in 'sandra decide'"
    )
    parser.add_argument("--command", dest="wish", metavar="TEXT", help="the driver's wish")
    add_server(parser)
    parser.add_argument(
        "--prediction", default="set-based", metavar="KIND", help="set-based or most-likely"
    )
    parser.add_argument("--rules", default="", metavar="LIST", help="e.g. R_G1,R_G2,R_G3")
    parser.add_argument(
        "--horizon", type=int, metavar="H", help="steps to verify (default: the paper's, 8 or 15)"
    )
    parser.add_argument(
        "--execution",
        default="trajectory",
        metavar="NAME",
        help="trajectory: certified trajectories; meta: the meta-actions of the paper",
    )
    parser.add_argument("--k", type=int, metavar="K", help="number of ranked pairs (default: 3)")
    parser.add_argument("--mode", default="rank", metavar="NAME", help="as in 'sandra decide'")
    parser.add_argument(
        "--emergency-braking",
        type=float,
        default=12.0,
        metavar="A",
        help="strongest braking while nothing can be certified, m/s^2",
    )
    parser.add_argument("--settings", metavar="FILE", help="a TOML file with parameters")
    add_assumptions(parser)
    add_context(parser, picture=False)
    parser.add_argument("--out", metavar="RUN", help="the run folder (default: runs/NAME)")
    parser.add_argument(
        "--no-view",
        action="store_true",
        help="write no view.jsonl: the page of 'sandra report' then lacks the reachable sets, and "
        "'sandra view' cannot follow",
    )
    add_workers(parser)
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    parser.set_defaults(run=_drive)


def drive_of(arguments: argparse.Namespace) -> Drive:
    from sandra.evaluation.closed_loop.drive import Drive
    from sandra.logic import parse_rules

    return Drive(
        environment=arguments.environment,
        setting=arguments.setting,
        profile=arguments.profile,
        steps=arguments.steps,
        ranker=arguments.ranker,
        command=arguments.wish,
        prediction=arguments.prediction,
        rules=tuple(parse_rules(arguments.rules)),
        horizon=arguments.horizon,
        execution=arguments.execution,
        mode=arguments.mode,
        k=arguments.k,
        emergency_braking=arguments.emergency_braking,
        deadline=arguments.deadline,
        base_url=arguments.base_url,
        prompt_options=prompt_options_of(arguments, None),
        cache=arguments.cache,
        max_concurrent=arguments.max_concurrent,
        prices=arguments.prices,
        settings=settings_of(arguments),
        assumptions=arguments.assumptions or ("settings" if arguments.settings else "paper"),
    )


def _drive(arguments: argparse.Namespace) -> int:
    from sandra.evaluation.closed_loop.batch import drive_all
    from sandra.evaluation.closed_loop.folder import RunFolder
    from sandra.rankers.usage import Usage, cost, told, total
    from sandra.view.report import FrameLog

    how, seeds = drive_of(arguments), seeds_of(arguments.seeds)
    prices = prices_of(arguments)
    out = Path(arguments.out or f"runs/{default_name(how)}")
    folder = RunFolder(out, None if arguments.no_view else FrameLog)
    folder.open(how, ["sandra", *sys.argv[1:]])
    found = drive_all(folder, how, seeds, workers_of(arguments), _progress)
    _progress("")
    usage = total(Usage.of_dict(x["cost"]["usage"]) for x in found if x.get("cost"))
    if arguments.json:
        money = cost(usage, how.ranker, prices)
        run = {"run": str(folder.path), "drive": how.to_dict()}
        print_json({**run, "episodes": found, "cost": money})
    else:
        for episode in found:
            print(_line(episode))
        bill = told(usage, how.ranker, prices)
        if bill:
            print(f"cost: {bill}")
        print(f"run folder: {folder.path}")
    return 0 if all(episode["collision"] is None for episode in found) else 1


def default_name(how: Drive) -> str:
    """Of the run folder, where the user gives none."""
    rules = "-".join(how.rules) or "no-rules"
    assumptions = "" if how.assumptions == "paper" else how.assumptions
    words = [how.name, how.profile, how.ranker, how.prediction, rules, how.command or ""]
    words += [assumptions, "" if how.execution == "trajectory" else how.execution]
    text = "_".join(word for word in words if word)
    return "".join(c if c.isalnum() or c in "-_." else "-" for c in text)[:120]


def seeds_of(text: str) -> list[int]:
    """ "1,2,5-9", or "paper"."""
    from sandra.simulation.highway import SEEDS

    found: list[int] = []
    for part in text.split(","):
        first, dash, last = part.strip().partition("-")
        if part.strip() == "paper":
            found += SEEDS
        elif first.isdecimal() and (last.isdecimal() if dash else True):
            found += range(int(first), int(last if dash else first) + 1)
        else:
            raise SandraError(f"--seeds {text}: write numbers and ranges, as 1,2,5-9, or paper")
    return list(dict.fromkeys(found))


def _line(episode: dict[str, Any]) -> str:
    m, collision = episode["metrics"], episode["collision"]
    operations = ", ".join(f"{name} {n}" for name, n in episode["operations"].items())
    lines = [
        f"seed {episode['seed']}: {'success' if m['success'] else 'no success'}, "
        f"{m['distance']:.1f} m in {m['steps']} steps, fail-safe "
        f"{100 * m['fail_safe_rate']:.0f} %, {m['lane_changes']} changes of lane; {operations}"
    ]
    kept = ", ".join(f"{rule} {n}" for rule, n in m["compliant_steps"].items())
    lines.append(f"  steps that keep {kept}; success steps {m['success_steps']}")
    lines += [f"  {sentence}" for sentence in episode["told"]]
    if collision is None and episode["ended"]:
        lines.append(f"  ended early: {episode['ended']}")
    mean, most = episode["decision_cpu"]
    lines.append(f"  our part of a decision: {mean:.2f} s of CPU time, at most {most:.2f} s")
    return "\n".join(lines)


def _progress(words: str) -> None:
    """On one line of a terminal; elsewhere nothing but what ends an episode."""
    if sys.stderr.isatty():
        print(f"\r\x1b[K{words}", end="", file=sys.stderr, flush=True)
