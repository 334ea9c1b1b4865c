"""`sandra bench`: what things cost."""

from __future__ import annotations

import argparse
from functools import partial
from pathlib import Path
from typing import Any

from sandra.cli.options import add_assumptions, command, path_of, settings_of
from sandra.cli.output import print_json, progress
from sandra.errors import SettingsError


def add(commands: Any) -> None:
    parser = command(
        commands, "bench", "measure what things cost", "sandra bench decide intersection"
    )
    actions = parser.add_subparsers(dest="action", metavar="ACTION", required=True)
    _add_decide(actions)
    _add_reach(actions)
    _add_growth(actions)


def _add_decide(actions: Any) -> None:
    parser = command(
        actions,
        "decide",
        "time decisions with certificates, stage by stage, in process CPU time",
        "sandra bench decide intersection merge --runs 20",
    )
    parser.add_argument(
        "scenarios",
        metavar="SCENARIO",
        nargs="*",
        default=["intersection"],
        help="CommonRoad files, or names of 'sandra scenarios'",
    )
    parser.add_argument("--prediction", default="most-likely", metavar="KIND", help="see verify")
    add_assumptions(parser)
    parser.add_argument("--rules", default="", metavar="LIST", help="e.g. R_G1,R_G2,R_G3")
    parser.add_argument("--all", action="store_true", help="verify all twelve pairs")
    parser.add_argument("--runs", type=int, default=20, metavar="N", help="counted runs of each")
    parser.add_argument("--settings", metavar="FILE", help="a TOML file with parameters")
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    parser.set_defaults(run=_decide)


def _decide(arguments: argparse.Namespace) -> int:
    from sandra.evaluation.timing import time_decision
    from sandra.logic import parse_rules
    from sandra.scene import load

    _check_runs(arguments.runs)
    settings = settings_of(arguments)
    found = []
    for name in arguments.scenarios:
        scene = load(path_of(name), settings=settings)
        times = time_decision(
            scene,
            prediction=arguments.prediction,
            rules=parse_rules(arguments.rules),
            settings=settings,
            all_pairs=arguments.all,
            runs=arguments.runs,
            progress=partial(_tell, scene.name, arguments.runs),
        )
        progress("")
        found.append(times)
        if not arguments.json:
            print(times)
    if arguments.json:
        print_json({"decisions": [times.to_dict() for times in found]})
    return 0


def _check_runs(runs: int) -> None:
    if runs < 1:
        raise SettingsError(f"--runs {runs}: at least one run is needed")


def _add_reach(actions: Any) -> None:
    parser = command(
        actions,
        "reach",
        "check and time reachable sets beside those of CommonRoad-Reach, in process CPU time",
        "sandra bench reach merge my_scenario.xml --horizons 25",
    )
    parser.add_argument(
        "scenarios",
        metavar="SCENARIO",
        nargs="*",
        help="CommonRoad files, or names of 'sandra scenarios'; none: all of those",
    )
    parser.add_argument("--horizons", default="15,25,50", metavar="LIST", help="numbers of steps")
    parser.add_argument("--runs", type=int, default=10, metavar="N", help="counted runs of each")
    parser.add_argument(
        "--pair", default="keep,follow-lane", metavar="PAIR", help="the pair that is timed alone"
    )
    parser.add_argument(
        "--tolerance",
        type=float,
        default=1.25,
        metavar="X",
        help="largest factor between the two areas of a step at matched resolution",
    )
    parser.add_argument(
        "--peer",
        default=".venv-peer/bin/python",
        metavar="PYTHON",
        help="interpreter of the peer's environment",
    )
    parser.add_argument("--no-peer", action="store_true", help="time ours alone")
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    parser.set_defaults(run=_reach)


def _reach(arguments: argparse.Namespace) -> int:
    from sandra.actions import ActionPair
    from sandra.evaluation.reach_bench import bench_reach
    from sandra.scenarios import examples

    _check_runs(arguments.runs)
    if not arguments.tolerance >= 1.0:
        raise SettingsError(f"--tolerance {arguments.tolerance}: a factor is at least 1")
    report = bench_reach(
        [path_of(name) for name in arguments.scenarios] or list(examples().values()),
        horizons=_horizons(arguments.horizons),
        python=None if arguments.no_peer else Path(arguments.peer),
        pair=ActionPair.parse(arguments.pair),
        runs=arguments.runs,
        tolerance=arguments.tolerance,
        progress=progress,
    )
    progress("")
    if arguments.json:
        print_json(report.to_dict())
    else:
        print(report)
    return 0


def _horizons(text: str) -> list[int]:
    words = text.split(",")
    if not all(word.strip().isdecimal() and int(word) >= 1 for word in words):
        raise SettingsError(f"--horizons {text}: write numbers of steps, such as 15,25,50")
    return [int(word) for word in words]


def _tell(scenario: str, runs: int, run: int) -> None:
    progress(f"{scenario}: run {run} of {runs}" if run else f"{scenario}: warming up")


def _add_growth(actions: Any) -> None:
    parser = command(
        actions,
        "growth",
        "time and memory of a verification against horizon, traffic and number of lanes",
        "sandra bench growth --axes obstacles,lanes --figure growth.pdf",
    )
    parser.add_argument(
        "--axes", default="horizon,obstacles,lanes", metavar="LIST", help="what grows"
    )
    parser.add_argument("--runs", type=int, default=5, metavar="N", help="counted runs of each")
    parser.add_argument("--figure", metavar="FILE", help="draw the curves (.png, .pdf, .svg)")
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    parser.set_defaults(run=_growth)


def _growth(arguments: argparse.Namespace) -> int:
    from sandra.evaluation.growth import AXES, measure_growth
    from sandra.view.growth import growth_figure

    axes = [axis.strip() for axis in arguments.axes.split(",")]
    if not set(axes) <= set(AXES):
        raise SettingsError(f"--axes {arguments.axes}: choose from {','.join(AXES)}")
    _check_runs(arguments.runs)
    growth = measure_growth(axes, runs=arguments.runs, progress=progress)
    progress("")
    if arguments.figure:
        growth_figure(growth, arguments.figure)
    if arguments.json:
        print_json(growth.to_dict() | {"figure": arguments.figure})
    else:
        print(growth)
    return 0
