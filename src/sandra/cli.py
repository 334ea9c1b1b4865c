"""The command line: reads words, calls the rooms, prints what they return. Nothing else.

Exit status: 0; 1 where a negative outcome was asked for (`sandra verify --pair` finds it UNSAFE);
2 for bad input, with one line that says what, where and how to mend it.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

from sandra.errors import SandraError

if TYPE_CHECKING:
    from sandra.decision import Decision
    from sandra.logic import Vocabulary
    from sandra.reach import Verdicts
    from sandra.scene import Scene
    from sandra.settings import Settings


class _Parser(argparse.ArgumentParser):
    def error(self, message: str) -> NoReturn:
        self.exit(2, f"{self.prog}: {message} (see '{self.prog} --help')\n")


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command; returns the exit status."""
    arguments = _parser().parse_args(argv)
    try:
        return int(arguments.run(arguments))
    except SandraError as error:
        print(f"sandra {arguments.command}: {error}", file=sys.stderr)
        return 2
    except BrokenPipeError:
        # The reader of the output went away (`| head`); nothing is left to be said.
        sys.stderr.close()
        return 0
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr)
        return 130


def _parser() -> argparse.ArgumentParser:
    from sandra import __version__

    parser = _Parser(
        prog="sandra",
        description="Safe decisions of language models for automated vehicles: every action pair "
        "is verified by reachability analysis before it is driven.",
        epilog="example: sandra decide intersection --command 'drive faster' --figure decision.png",
    )
    parser.add_argument("--version", action="version", version=f"sandra {__version__}")
    commands = parser.add_subparsers(dest="command", metavar="COMMAND", required=True)
    _add_decide(commands)
    _add_verify(commands)
    _add_prompt(commands)
    _add_certificate(commands)
    _add_scenarios(commands)
    _add_demo(commands)
    return parser


def _command(commands: Any, name: str, text: str, example: str) -> argparse.ArgumentParser:
    parser: argparse.ArgumentParser = commands.add_parser(
        name,
        help=text,
        description=text[0].upper() + text[1:] + ".",
        epilog=f"example: {example}",
        formatter_class=argparse.ArgumentDefaultsHelpFormatter,
    )
    return parser


def _add_scenario(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "scenario", metavar="SCENARIO", help="a CommonRoad file, or a name of 'sandra scenarios'"
    )
    parser.add_argument(
        "--problem", type=int, metavar="ID", help="planning problem, where the file has several"
    )
    parser.add_argument("--settings", metavar="FILE", help="a TOML file with parameters")
    parser.add_argument("--json", action="store_true", help="print one JSON object")


def _add_verification(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--prediction",
        default="most-likely",
        metavar="KIND",
        help="of the other traffic: most-likely, set-based, recorded or constant-velocity",
    )
    parser.add_argument(
        "--rules", default="", metavar="LIST", help="traffic rules, e.g. R_G1,R_G2,R_G3"
    )
    parser.add_argument("--horizon", type=int, metavar="H", help="steps to verify (default: 25)")
    parser.add_argument(
        "--vocabulary", metavar="FILE", help="a TOML file with actions and rules of your own"
    )
    parser.add_argument("--figure", metavar="FILE", help="draw it: .png, .pdf or .svg")


def _add_prompting(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--command", dest="wish", metavar="TEXT", help="the driver's wish")
    parser.add_argument("--k", type=int, metavar="K", help="number of ranked pairs (default: 3)")
    parser.add_argument(
        "--past", default="", metavar="PAIRS", help="pairs driven before, oldest first, ';' between"
    )
    parser.add_argument("--rule-prompt", action="store_true", help="tell the rules in the prompt")


def _add_decide(commands: Any) -> None:
    parser = _command(
        commands,
        "decide",
        "describe a scenario, have action pairs ranked, verify them, choose what is executed",
        "sandra decide intersection --command 'drive faster' --prediction set-based "
        "--rules R_G1,R_G2,R_G3 --figure decision.png",
    )
    _add_scenario(parser)
    _add_prompting(parser)
    parser.add_argument(
        "--ranker",
        default="rules",
        metavar="NAME",
        help="rules (rule-based, no language model), openai:MODEL, random:SEED, replay:FILE, "
        "exhaustive, or MODULE:ATTRIBUTE of your own",
    )
    parser.add_argument("--base-url", metavar="URL", help="of an OpenAI-compatible server")
    parser.add_argument(
        "--deadline", type=float, default=30.0, metavar="SECONDS", help="for the whole ranking"
    )
    _add_verification(parser)
    parser.add_argument(
        "--accept",
        default="certified",
        metavar="LEVEL",
        help="weakest verdict that is executed: certified, or reachable as in the paper",
    )
    parser.add_argument(
        "--certificate", metavar="FILE", help="write the certificate of what is executed: .json"
    )
    parser.add_argument(
        "--walk",
        default="ranked",
        metavar="HOW",
        help="which pairs to verify: ranked, first (stop at the first that holds) or all",
    )
    parser.set_defaults(run=_decide)


def _add_verify(commands: Any) -> None:
    parser = _command(
        commands,
        "verify",
        "verify action pairs of a scenario, without a ranking",
        "sandra verify intersection --all --prediction set-based",
    )
    _add_scenario(parser)
    choice = parser.add_mutually_exclusive_group(required=True)
    choice.add_argument("--pair", metavar="PAIR", help="e.g. accelerate,right-lane")
    choice.add_argument("--all", action="store_true", help="all twelve pairs")
    _add_verification(parser)
    parser.add_argument(
        "--corridor", metavar="FILE", help="write the pair's corridor (JSON) for a planner of yours"
    )
    parser.set_defaults(run=_verify)


def _add_prompt(commands: Any) -> None:
    parser = _command(
        commands,
        "prompt",
        "print the exact prompt, and the JSON schema of the answer",
        "sandra prompt intersection --command 'drive faster'",
    )
    _add_scenario(parser)
    _add_prompting(parser)
    parser.add_argument("--rules", default="", metavar="LIST", help="rules for --rule-prompt")
    parser.set_defaults(run=_prompt)


def _add_scenarios(commands: Any) -> None:
    parser = _command(
        commands, "scenarios", "list the scenarios that come with SanDRA", "sandra scenarios"
    )
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    parser.set_defaults(run=_scenarios)


def _add_certificate(commands: Any) -> None:
    parser = _command(
        commands,
        "certificate",
        "check a certificate with code that neither planned nor verified it",
        "sandra certificate check certificate.json",
    )
    actions = parser.add_subparsers(dest="action", metavar="ACTION", required=True)
    check = _command(
        actions,
        "check",
        "derive every claim anew: exit status 0 accepted, 1 rejected, 2 unreadable",
        "sandra certificate check certificate.json",
    )
    check.add_argument("file", metavar="FILE", help="what --certificate wrote")
    check.add_argument("--json", action="store_true", help="print one JSON object")
    parser.set_defaults(run=_check)


def _check(arguments: argparse.Namespace) -> int:
    from sandra.certificate import check_file

    report = check_file(arguments.file)
    if arguments.json:
        _print_json(report.to_dict())
    else:
        print(report)
    return 0 if report.accepted else 1


def _add_demo(commands: Any) -> None:
    parser = _command(
        commands,
        "demo",
        "decide the intersection scenario that comes with SanDRA, and draw it",
        "sandra demo --out demo",
    )
    parser.add_argument("--out", default="demo", metavar="FOLDER", help="where the picture goes")
    parser.set_defaults(run=_demo)


def _demo(arguments: argparse.Namespace) -> int:
    picture = Path(arguments.out) / "decision.png"
    print("sandra decide intersection --command 'drive faster' --walk all --figure", picture)
    print("(ranked by the embedded rule-based ranker 'rules'; no language model is asked)\n")
    try:
        picture.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise SandraError(
            f"{picture.parent}: no folder can be made there ({error.strerror}); choose --out"
        ) from None
    words = ["intersection", "--command", "drive faster", "--walk", "all"]
    return main(["decide", *words, "--figure", str(picture)])


def _decide(arguments: argparse.Namespace) -> int:
    from sandra.decision import decide
    from sandra.describe import render
    from sandra.logic import parse_rules

    settings = _settings(arguments)
    decision = decide(
        _scene(arguments, settings),
        arguments.ranker,
        arguments.wish,
        prediction=arguments.prediction,
        rules=parse_rules(arguments.rules),
        horizon=arguments.horizon,
        k=arguments.k,
        accept=arguments.accept,
        past=_past(arguments.past),
        deadline=arguments.deadline,
        base_url=arguments.base_url,
        settings=settings,
        vocabulary=_vocabulary(arguments),
        walk=arguments.walk,
        rule_prompt=arguments.rule_prompt,
        progress=_progress,
    )
    figure = _figure(decision, arguments.figure)
    written = _certificate(decision, arguments.certificate)
    if arguments.json:
        _print_json({**decision.to_dict(), "figure": figure, "certificate": written})
        return 0
    print(render(decision.prompt))
    print()
    if decision.ranking.reasoning:
        print(f"<{decision.ranking.ranker}>: {decision.ranking.reasoning}\n")
    print(decision)
    if figure:
        print(f"  picture: {figure}")
    if written:
        print(f"  certificate: {written} (check it: sandra certificate check {written})")
    elif arguments.certificate:
        print("  certificate: none is written, what is executed has none")
    return 0


def _certificate(decision: Decision, path: str | None) -> str | None:
    if path is None or decision.certificate is None:
        return None
    from sandra.certificate import save

    return str(save(decision.certificate, path))


def _verify(arguments: argparse.Namespace) -> int:
    from sandra.logic import parse_rules
    from sandra.reach import Status, verify

    if arguments.corridor and arguments.all:
        raise SandraError("--corridor is that of one pair: give --pair instead of --all")
    settings = _settings(arguments)
    scene = _scene(arguments, settings)
    _progress("verify")
    verdicts = verify(
        scene,
        "all" if arguments.all else arguments.pair,
        prediction=arguments.prediction,
        rules=parse_rules(arguments.rules),
        horizon=arguments.horizon,
        settings=settings,
        vocabulary=_vocabulary(arguments),
    )
    _progress("")
    figure = _figure(verdicts, arguments.figure)
    corridor = _corridor(verdicts, arguments.corridor)
    if arguments.json:
        prediction = verdicts.ground.prediction
        _print_json(
            {
                "scenario": scene.name,
                "prediction": prediction.kind,
                "assumed": list(prediction.notes),
                "rules": list(verdicts.rules),
                "horizon": verdicts.ground.horizon,
                "dt": scene.dt,
                "verdicts": verdicts.to_list(),
                "figure": figure,
                "corridor": corridor,
            }
        )
    else:
        for note in verdicts.ground.prediction.notes:
            print(f"note: {note}")
        print(verdicts)
        if figure:
            print(f"picture: {figure}")
        if corridor:
            print(f"corridor: {corridor}")
        elif arguments.corridor:
            print("corridor: none is written, the pair has none")
    unsafe = not arguments.all and verdicts[0].status is Status.UNSAFE
    return 1 if unsafe else 0


def _corridor(verdicts: Verdicts, path: str | None) -> str | None:
    if path is None or verdicts[0].first_empty_step is not None:
        return None
    text = json.dumps(verdicts.corridor(0), allow_nan=False)
    try:
        Path(path).write_text(text, encoding="utf-8")
    except OSError as error:
        raise SandraError(f"{path}: cannot be written ({error.strerror})") from None
    return path


def _prompt(arguments: argparse.Namespace) -> int:
    from sandra.describe import describe, render
    from sandra.logic import parse_rules

    settings = _settings(arguments)
    if arguments.k is not None:
        settings = settings.replace(k=arguments.k)
    prompt = describe(
        _scene(arguments, settings),
        arguments.wish,
        _past(arguments.past),
        rules=parse_rules(arguments.rules),
        rule_prompt=arguments.rule_prompt,
        settings=settings,
    )
    if arguments.json:
        _print_json({"system": prompt.system, "user": prompt.user, "schema": prompt.schema})
    else:
        print(render(prompt))
        print()
        print(json.dumps(prompt.schema, indent=2))
    return 0


def _scenarios(arguments: argparse.Namespace) -> int:
    from sandra.scenarios import examples

    found = {name: str(path) for name, path in examples().items()}
    if arguments.json:
        _print_json(found)
    else:
        for name, path in found.items():
            print(f"{name:<20} {path}")
    return 0


def _settings(arguments: argparse.Namespace) -> Settings:
    from sandra.settings import Settings

    return Settings.load(arguments.settings) if arguments.settings else Settings()


def _vocabulary(arguments: argparse.Namespace) -> Vocabulary | None:
    if arguments.vocabulary is None:
        return None
    from sandra.logic import Vocabulary

    return Vocabulary.load(arguments.vocabulary)


def _scene(arguments: argparse.Namespace, settings: Settings) -> Scene:
    from sandra.scenarios import examples
    from sandra.scene import load

    known = examples()
    given = Path(arguments.scenario)
    path = given if given.exists() else known.get(arguments.scenario, given)
    return load(path, planning_problem=arguments.problem, settings=settings)


def _past(text: str) -> tuple[Any, ...]:
    from sandra.actions import ActionPair

    return tuple(ActionPair.parse(pair) for pair in text.split(";") if pair.strip())


def _figure(subject: Any, path: str | None) -> str | None:
    if path is None:
        return None
    _progress("draw")
    drawn = str(subject.figure(path))
    _progress("")
    return drawn


def _progress(stage: str) -> None:
    """The current stage on one line of the terminal; nothing where stderr is no terminal."""
    if sys.stderr.isatty():
        print(f"\r\x1b[K{stage}..." if stage else "\r\x1b[K", end="", file=sys.stderr, flush=True)


def _print_json(data: dict[str, Any]) -> None:
    """One JSON object; numbers that JSON lacks (infinite, undefined) become null."""
    print(json.dumps(_finite(data), allow_nan=False))


def _finite(value: Any) -> Any:
    if isinstance(value, float) and value - value != 0.0:
        return None
    if isinstance(value, dict):
        return {key: _finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(item) for item in value]
    return value


if __name__ == "__main__":
    sys.exit(main())
