"""`sandra bench`: what things cost."""

from __future__ import annotations

import argparse
from functools import partial
from typing import Any

from sandra.cli.options import command, path_of, settings_of
from sandra.cli.output import print_json, progress
from sandra.errors import SettingsError


def add(commands: Any) -> None:
    parser = command(
        commands, "bench", "measure what a decision costs", "sandra bench decide intersection"
    )
    actions = parser.add_subparsers(dest="action", metavar="ACTION", required=True)
    _add_decide(actions)


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

    if arguments.runs < 1:
        raise SettingsError(f"--runs {arguments.runs}: at least one run is needed")
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


def _tell(scenario: str, runs: int, run: int) -> None:
    progress(f"{scenario}: run {run} of {runs}" if run else f"{scenario}: warming up")
