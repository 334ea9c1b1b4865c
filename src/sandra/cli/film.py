"""`sandra film`: a recording as a film, or one frame of it."""

from __future__ import annotations

import argparse
from typing import Any

from sandra.cli.options import command, path_of
from sandra.cli.output import progress


def add(commands: Any) -> None:
    parser = command(
        commands,
        "film",
        "film a recorded drive; past bodies are drawn fainter",
        "sandra film recorded-ego --out drive.mp4",
    )
    parser.add_argument(
        "scenario",
        metavar="SCENARIO",
        help="a CommonRoad file with the ego's trajectory, or a name of 'sandra scenarios'",
    )
    parser.add_argument(
        "--out",
        required=True,
        metavar="FILE",
        help=".mp4 or .gif; with --step a picture: .png, .pdf or .svg",
    )
    parser.add_argument("--step", type=int, metavar="N", help="this step only, from 0 on")
    parser.add_argument(
        "--speed", type=float, default=1.0, metavar="X", help="1 is real time, 0.5 half as fast"
    )
    parser.add_argument(
        "--problem", type=int, metavar="ID", help="planning problem, where the file has several"
    )
    parser.set_defaults(run=_film)


def _film(arguments: argparse.Namespace) -> int:
    from sandra.scene import load
    from sandra.view import film, film_frame

    scene = load(path_of(arguments.scenario), planning_problem=arguments.problem)
    if arguments.step is not None:
        path = film_frame(scene, arguments.out, arguments.step)
    else:
        path = film(
            scene,
            arguments.out,
            speed=arguments.speed,
            progress=lambda done, total: progress(f"frame {done} of {total}"),
        )
        progress("")
    print(path)
    return 0
