"""`sandra evaluate open-loop`: recorded situations, ranked, verified, held against labels."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sandra.cli.label import add_choice, add_scenarios, choice_of, files_of
from sandra.cli.options import add_format, add_workers, command, settings_of, workers_of
from sandra.cli.output import print_json, progress, tell_written, write_files
from sandra.cli.rankings import write_tables
from sandra.errors import SandraError

if TYPE_CHECKING:
    from sandra.evaluation.labelling.batch import Places
    from sandra.evaluation.open_loop.evaluate import OpenLoop
    from sandra.evaluation.open_loop.setups import Conditions, Setup

_RULE_PROMPTS = {"off": (False,), "on": (True,), "both": (False, True)}


def add(actions: Any) -> None:
    parser = command(
        actions,
        "open-loop",
        "have recorded situations ranked, verify all pairs, compare with what was driven: every "
        "combination of rankers, commands, rule prompts and horizons, beside trivial baselines; "
        "what is in the folder already is not asked again; exit status 1 if a row is an error",
        "sandra evaluate open-loop recordings/ --ranker rules --ranker openai:gpt-4o "
        "--command none --command 'drive cautiously' --horizon 10,25,50 --rule-prompt both "
        "--workers auto --out runs/open-loop --figures",
        "on a Dask cluster: sandra evaluate open-loop recordings/ --scheduler tcp://HOST:8786",
    )
    add_scenarios(parser)
    parser.add_argument(
        "--ranker",
        action="append",
        metavar="NAME",
        help="as of 'sandra decide'; may be repeated (default: rules)",
    )
    parser.add_argument("--base-url", metavar="URL", help="of an OpenAI-compatible server")
    parser.add_argument(
        "--deadline", type=float, default=30.0, metavar="SECONDS", help="for a whole ranking"
    )
    parser.add_argument(
        "--command",
        dest="wishes",
        action="append",
        metavar="TEXT",
        help="the driver's wish, none for none; may be repeated (default: none)",
    )
    parser.add_argument(
        "--rule-prompt", choices=tuple(_RULE_PROMPTS), default="off", help="tell the rules in words"
    )
    parser.add_argument(
        "--horizon",
        metavar="LIST",
        help="steps to verify, commas between (default: that of the settings, 25)",
    )
    parser.add_argument("--k", type=int, default=3, metavar="K", help="number of ranked pairs")
    parser.add_argument(
        "--prediction",
        default="most-likely",
        metavar="KIND",
        help="of the others: most-likely (as recorded), set-based, recorded, constant-velocity",
    )
    parser.add_argument(
        "--rules", default="", metavar="LIST", help="traffic rules to verify, e.g. R_G1,R_G2,R_G3"
    )
    parser.add_argument(
        "--accept",
        default="reachable",
        metavar="LEVEL",
        help="what counts as verified: reachable, as in the paper, or certified",
    )
    parser.add_argument(
        "--labeler", choices=("mean", "strict", "area"), default="mean", help="see 'sandra label'"
    )
    add_choice(parser, "--label-horizon", windows=1)
    parser.add_argument(
        "--rows",
        metavar="FILE.jsonl",
        help="of 'sandra dataset build' on the one folder that is named: its labelled windows, "
        "balanced as they may be, instead of those of --ego, --stride and --windows",
    )
    parser.add_argument(
        "--split", choices=("train", "validation", "test", "all"), default="test", help="of --rows"
    )
    parser.add_argument("--settings", metavar="FILE", help="a TOML file with parameters")
    add_workers(parser)
    parser.add_argument(
        "--out",
        default="runs/open-loop",
        metavar="FOLDER",
        help="rows.jsonl, rankings.csv, the tables as .md, .tex, .csv, and scores.json",
    )
    add_format(parser)
    parser.add_argument(
        "--figures",
        action="store_true",
        help="draw bars with intervals for what varies, and durations, as .pdf",
    )
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    parser.set_defaults(run=_open_loop)


def _open_loop(arguments: argparse.Namespace) -> int:
    from sandra.evaluation.open_loop.evaluate import open_loop

    out = Path(arguments.out)
    only = None if arguments.rows is None else _places(arguments)
    found = open_loop(
        files_of(arguments.scenarios) if only is None else list(only),
        setups_of(arguments),
        choice_of(arguments, arguments.labeler),
        conditions_of(arguments),
        only=only,
        journal=out / "journal.jsonl",
        workers=workers_of(arguments),
        progress=lambda done, total, name: progress(f"{done} of {total} files: {name}"),
    )
    progress("")
    written = _write(found, out)
    if arguments.figures:
        written += _draw(found, out)
    if arguments.json:
        told = found.report.to_dict() | {"errors": len(found.errors)}
        told["without_verified_pair"] = [
            {"horizon": int(h), "because": why, "scenarios": int(n)}
            for h, why, n in found.nothing_verified().rows
        ]
        print_json({**told, "files": [str(file) for file in written]})
    else:
        for sheet in (*found.report.sheets().values(), found.nothing_verified()):
            if sheet.rows:
                print(sheet.text(arguments.format))
        tell_written(written)
    return 1 if found.errors else 0


def _places(arguments: argparse.Namespace) -> dict[Path, Places]:
    """By file, the egos and steps of the rows that have a label."""
    from sandra.learn.rows import read_rows

    if len(arguments.scenarios) != 1:
        raise SandraError("--rows: name the one folder that the rows were built from")
    found: dict[Path, list[tuple[int, int]]] = {}
    for row in read_rows(Path(arguments.rows)):
        if not row.is_labelled or arguments.split not in ("all", row.split):
            continue
        if row.ego is not None and row.step is not None:
            path = Path(arguments.scenarios[0]) / row.scenario
            found.setdefault(path, []).append((row.ego, row.step))
    if not found:
        raise SandraError(f"{arguments.rows}: no labelled row in split '{arguments.split}'")
    return {path: tuple(places) for path, places in found.items()}


def setups_of(arguments: argparse.Namespace) -> tuple[Setup, ...]:
    from sandra.evaluation.open_loop.setups import grid
    from sandra.rankers import create

    rankers = list(dict.fromkeys(arguments.ranker or ["rules"]))
    for ranker in rankers:
        # Rather an error now than after minutes.
        create(ranker, base_url=arguments.base_url, deadline=arguments.deadline)
    wishes = [None if w.strip().lower() == "none" else w for w in arguments.wishes or ["none"]]
    horizons = [settings_of(arguments).horizon]
    if arguments.horizon is not None:
        try:
            horizons = [int(word) for word in arguments.horizon.split(",")]
        except ValueError:
            raise SandraError(
                f"--horizon {arguments.horizon}: whole numbers of steps, commas between"
            ) from None
    return grid(rankers, wishes, _RULE_PROMPTS[arguments.rule_prompt], horizons)


def conditions_of(arguments: argparse.Namespace) -> Conditions:
    from sandra.evaluation.open_loop.setups import Conditions
    from sandra.logic import parse_rules

    return Conditions(
        k=arguments.k,
        prediction=arguments.prediction,
        rules=parse_rules(arguments.rules),
        accept=arguments.accept,
        base_url=arguments.base_url,
        deadline=arguments.deadline,
        settings=settings_of(arguments),
    )


def _write(found: OpenLoop, out: Path) -> list[Path]:
    files = {out / "rows.jsonl": found.jsonl(), out / "rankings.csv": found.rankings_csv()}
    return [*write_files(out, files), *write_tables(found.report, out)]


def _draw(found: OpenLoop, out: Path) -> list[Path]:
    from sandra.view.ablation import ablation_figure
    from sandra.view.durations import durations_figure

    durations = found.durations()
    timed = [durations_figure(durations, out / "runtimes.pdf")] if any(durations.values()) else []
    return timed + [
        ablation_figure(bars, out / f"ablation-{factor.replace('_', '-')}.pdf")
        for factor, bars in found.bars().items()
    ]
