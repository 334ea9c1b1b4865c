"""`sandra figure`: one picture of one thing, for a paper."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from sandra.cli.options import (
    add_prompting,
    add_scenario,
    add_verification,
    command,
    path_of,
    scene_of,
    settings_of,
    vocabulary_of,
)
from sandra.cli.output import progress
from sandra.errors import SandraError

KINDS = "most-likely,set-based"


def add(commands: Any) -> None:
    parser = command(
        commands,
        "figure",
        "one figure of a paper: scenario, predictions, set, maneuver, robustness",
        "sandra figure predictions intersection --out predictions.pdf",
        "sandra figure set intersection --pair stop,follow-lane --3d --out set.pdf",
    )
    kinds = parser.add_subparsers(dest="what", metavar="WHAT", required=True)
    _scenario(kinds)
    _predictions(kinds)
    _set(kinds)
    _maneuver(kinds)
    _robustness(kinds)


def _out(parser: argparse.ArgumentParser, run: Any) -> None:
    parser.add_argument("--out", required=True, metavar="FILE", help=".pdf, .svg or .png")
    parser.set_defaults(run=run)


def _scenario(kinds: Any) -> None:
    parser = command(
        kinds,
        "scenario",
        "the scenario at its first step",
        "sandra figure scenario merge --out a.pdf",
    )
    add_scenario(parser)
    _out(parser, _draw_scenario)


def _predictions(kinds: Any) -> None:
    parser = command(
        kinds,
        "predictions",
        "where the others may be, by each prediction",
        "sandra figure predictions merge --out a.pdf",
    )
    add_scenario(parser)
    parser.add_argument("--kinds", default=KINDS, metavar="LIST", help="one map for each")
    parser.add_argument("--horizon", type=int, metavar="H", help="steps (default: 25)")
    _out(parser, _draw_predictions)


def _set(kinds: Any) -> None:
    parser = command(
        kinds,
        "set",
        "the reachable set of one pair: from above, at one step, or with time upwards",
        "sandra figure set intersection --pair decelerate,follow-lane --step 10 --out a.pdf",
    )
    add_scenario(parser)
    add_verification(parser)
    parser.add_argument("--pair", required=True, metavar="PAIR", help="e.g. accelerate,right-lane")
    shown = parser.add_mutually_exclusive_group()
    shown.add_argument("--step", type=int, metavar="K", help="the set at this step only")
    shown.add_argument("--3d", dest="three_d", action="store_true", help="time upwards")
    _out(parser, _draw_set)


def _maneuver(kinds: Any) -> None:
    parser = command(
        kinds,
        "maneuver",
        "what a decision drives: planned and fail-safe path, and their profiles",
        "sandra figure maneuver nothing-safe --out a.pdf",
    )
    add_scenario(parser)
    add_prompting(parser)
    add_verification(parser)
    parser.add_argument("--ranker", default="rules", metavar="NAME", help="see decide")
    _out(parser, _draw_maneuver)


def _robustness(kinds: Any) -> None:
    parser = command(
        kinds,
        "robustness",
        "the rules' robustness along several recorded drives",
        "sandra figure robustness A.xml B.xml --names DiLu,SanDRA --out a.pdf",
    )
    parser.add_argument("recordings", nargs="+", metavar="RECORDING", help="at most four")
    parser.add_argument("--names", metavar="LIST", help="for the legend (default: of the files)")
    parser.add_argument("--rules", default="R_G1,R_G2,R_G3", metavar="LIST", help="rules to watch")
    parser.add_argument("--settings", metavar="FILE", help="a TOML file with parameters")
    _out(parser, _draw_robustness)


def _draw_scenario(arguments: argparse.Namespace) -> int:
    from sandra.view import scene_figure

    print(scene_figure(scene_of(arguments, settings_of(arguments)), arguments.out))
    return 0


def _draw_predictions(arguments: argparse.Namespace) -> int:
    from sandra.view import predictions_figure

    settings = settings_of(arguments)
    scene = scene_of(arguments, settings)
    kinds = [kind.strip() for kind in arguments.kinds.split(",") if kind.strip()]
    shown = {"horizon": arguments.horizon, "settings": settings}
    print(predictions_figure(scene, arguments.out, kinds, **shown))
    return 0


def _draw_set(arguments: argparse.Namespace) -> int:
    from sandra.logic import parse_rules
    from sandra.reach import verify
    from sandra.view import set_figure

    settings = settings_of(arguments)
    verdicts = verify(
        scene_of(arguments, settings),
        arguments.pair,
        prediction=arguments.prediction,
        rules=parse_rules(arguments.rules),
        horizon=arguments.horizon,
        settings=settings,
        vocabulary=vocabulary_of(arguments),
    )
    shown = {"step": arguments.step, "three_d": arguments.three_d}
    print(set_figure(verdicts, 0, arguments.out, **shown))
    return 0


def _draw_maneuver(arguments: argparse.Namespace) -> int:
    from sandra.cli.options import past_of
    from sandra.decision import decide
    from sandra.logic import parse_rules
    from sandra.view import maneuver_figure

    settings = settings_of(arguments)
    progress("decide")
    decision = decide(
        scene_of(arguments, settings),
        arguments.ranker,
        arguments.wish,
        prediction=arguments.prediction,
        rules=parse_rules(arguments.rules),
        horizon=arguments.horizon,
        k=arguments.k,
        past=past_of(arguments.past),
        settings=settings,
        vocabulary=vocabulary_of(arguments),
        rule_prompt=arguments.rule_prompt,
    )
    progress("")
    print(maneuver_figure(decision, arguments.out))
    return 0


def _draw_robustness(arguments: argparse.Namespace) -> int:
    from sandra.monitor import monitor
    from sandra.scene import load
    from sandra.view import comparison_figure

    settings = settings_of(arguments)
    paths = [path_of(each) for each in arguments.recordings]
    told = arguments.names.split(",") if arguments.names else [_name(path) for path in paths]
    names = [name.strip() for name in told]
    if len(set(names)) != len(paths):
        raise SandraError("--names: give as many different names as there are recordings")
    drives = {
        name: monitor(load(path, settings=settings), arguments.rules, settings)
        for name, path in zip(names, paths, strict=True)
    }
    print(comparison_figure(drives, arguments.out))
    return 0


def _name(path: Path) -> str:
    return f"{path.parent.name}/{path.stem}" if path.stem == "scenario" else path.stem
