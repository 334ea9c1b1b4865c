"""`sandra monitor`: how well a recorded trajectory keeps the traffic rules."""

from __future__ import annotations

import argparse
from typing import Any

from sandra.cli.options import add_scenario, command, scene_of, settings_of
from sandra.cli.output import figure_of, print_json
from sandra.errors import SandraError


def add(commands: Any) -> None:
    parser = command(
        commands,
        "monitor",
        "robustness of the traffic rules along the ego's recorded trajectory: exit status 0 if "
        "all are kept, 1 if one is broken",
        "sandra monitor recorded-ego --rules R_G1,R_G3 --figure robustness.png",
    )
    add_scenario(parser)
    parser.add_argument("--rules", default="R_G1,R_G2,R_G3", metavar="LIST", help="rules to watch")
    parser.add_argument(
        "--justified",
        default="",
        metavar="STEPS",
        help="steps at which abrupt braking is justified, e.g. 3-7,12",
    )
    parser.add_argument("--figure", metavar="FILE", help="draw it: .png, .pdf or .svg")
    parser.set_defaults(run=_monitor)


def _monitor(arguments: argparse.Namespace) -> int:
    from sandra.monitor import monitor

    settings = settings_of(arguments)
    scene = scene_of(arguments, settings)
    justified = None
    if arguments.justified and scene.recorded_ego is not None:
        justified = _steps(arguments.justified, len(scene.recorded_ego))
    found = monitor(scene, arguments.rules, settings, justified=justified)
    drawn = figure_of(found, arguments.figure)
    if arguments.json:
        print_json({**found.to_dict(), **({"figure": drawn} if drawn else {})})
    else:
        print(found)
        if drawn:
            print(f"figure: {drawn}")
    return 0 if found.holds else 1


def _steps(text: str, n: int) -> Any:
    import numpy as np

    mask = np.zeros(n, dtype=bool)
    for part in text.split(","):
        first, _, last = part.strip().partition("-")
        last = last or first
        if not (first.isdecimal() and last.isdecimal() and int(first) <= int(last) < n):
            raise SandraError(
                f"--justified {text}: '{part.strip()}' is no step or range of steps from 0 to "
                f"{n - 1}; write e.g. 3-7,12"
            )
        mask[int(first) : int(last) + 1] = True
    return mask
