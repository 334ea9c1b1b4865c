"""`sandra decide`: one cycle on one scenario."""

from __future__ import annotations

import argparse
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from sandra.cli.options import (
    add_prompting,
    add_scenario,
    add_server,
    add_verification,
    command,
    past_of,
    prices_of,
    scene_of,
    settings_of,
    vocabulary_of,
)
from sandra.cli.output import figure_of, print_json, progress
from sandra.cli.prompting import add_context, prompt_options_of, save_picture

if TYPE_CHECKING:
    from sandra.decision import Decision


def add(commands: Any) -> None:
    parser = command(
        commands,
        "decide",
        "describe a scenario, have action pairs ranked, verify them, choose what is executed",
        "sandra decide intersection --command 'drive faster' --prediction set-based "
        "--rules R_G1,R_G2,R_G3 --mode verify-first --report decision.html",
        "sandra decide merge --ranker openai:MODEL --base-url http://localhost:8000/v1 "
        "--deadline 2 --mode repair --cache answers --prices prices.toml",
        "sandra decide merge --ranker openai:MODEL --vision ego --picture look.png --measures all",
    )
    add_scenario(parser)
    add_prompting(parser)
    parser.add_argument(
        "--ranker",
        default="embedded",
        metavar="NAME",
        help="embedded (a small language model that comes along, docs/embedded.md); rules "
        "(rule-based, no language model); a model on a server: openai:MODEL "
        "(openai:gpt-5-mini, or openai:gpt-5-mini#api=responses), ollama:MODEL (ollama:qwen3:4b), "
        "vllm:MODEL (vllm:Qwen/Qwen3-4B), dilu:MODEL (DiLu's loop, docs/dilu.md); "
        "one in this process: gguf:FILE (gguf:model.gguf), "
        "hf:FOLDER[+ADAPTER] (hf:my-model+my-lora, or hf:my-model#mode=score); exhaustive, "
        "random:SEED (random:7), replay:FILE (replay:rankings.csv#run=ft), or MODULE:ATTRIBUTE "
        "of your own; to see what a bad one does: adversarial, always:PAIR "
        "(always:keep,follow-lane), garbage, late:SECONDS (late:0.5)",
    )
    add_server(parser)
    add_context(parser)
    add_verification(parser)
    parser.add_argument(
        "--accept",
        default="certified",
        metavar="LEVEL",
        help="weakest verdict that is executed: certified, or reachable as in the paper",
    )
    parser.add_argument(
        "--desired-speed",
        type=float,
        metavar="V",
        help="what the planner aims at, m/s (default: the speed limit, else the present speed)",
    )
    parser.add_argument(
        "--report", metavar="F.html", help="write a page to look into it: one file, no network"
    )
    parser.add_argument(
        "--certificate", metavar="FILE", help="write the certificate of what is executed: .json"
    )
    parser.add_argument(
        "--mode",
        default="rank",
        metavar="NAME",
        help="rank (a ranking, then verdicts, as in the paper), verify-first (all pairs are "
        "verified while the ranker reads and reasons; it ranks those that hold), repair (as rank; "
        "where nothing ranked holds it is asked once more, with the reasons) or exhaustive "
        "(nobody is asked)",
    )
    parser.add_argument(
        "--walk",
        default="ranked",
        metavar="HOW",
        help="which pairs to verify after a ranking: ranked, first (stop at the first that holds) "
        "or all",
    )
    parser.set_defaults(run=_decide)


def _decide(arguments: argparse.Namespace) -> int:
    from sandra.decision import decide
    from sandra.describe import render
    from sandra.describe.tokens import tokens
    from sandra.logic import parse_rules
    from sandra.planning import Weights
    from sandra.rankers import create
    from sandra.rankers.usage import cost, told

    settings, prices = settings_of(arguments), prices_of(arguments)
    ranker = create(
        "exhaustive" if arguments.mode == "exhaustive" else arguments.ranker,
        base_url=arguments.base_url,
        deadline=arguments.deadline,
        cache=arguments.cache,
        max_concurrent=arguments.max_concurrent,
    )
    weights = replace(Weights.for_command(arguments.wish), desired_speed=arguments.desired_speed)
    scene = scene_of(arguments, settings)
    decision = decide(
        scene,
        ranker,
        arguments.wish,
        prediction=arguments.prediction,
        rules=parse_rules(arguments.rules),
        horizon=arguments.horizon,
        k=arguments.k,
        accept=arguments.accept,
        past=past_of(arguments.past),
        deadline=arguments.deadline,
        settings=settings,
        vocabulary=vocabulary_of(arguments),
        mode=arguments.mode,
        walk=arguments.walk,
        rule_prompt=arguments.rule_prompt,
        prompt_options=prompt_options_of(arguments, scene),
        weights=weights,
        progress=progress,
    )
    figure = figure_of(decision, arguments.figure)
    picture = save_picture(decision.prompt, arguments.picture)
    page = _page(decision, arguments)
    written = _certificate(decision, arguments.certificate)
    ranking = decision.ranking
    if arguments.json:
        files = {"figure": figure, "certificate": written}
        if page:
            files["report"] = page
        if picture:
            files["picture"] = picture
        money = cost(ranking.usage, ranking.ranker, prices)
        print_json({**decision.to_dict(), "cost": money, **files})
        return 0
    print(render(decision.prompt))
    print(tokens(decision.prompt, getattr(ranker, "count_tokens", None)))
    if picture:
        print(f"picture of the prompt: {picture}")
    print()
    if ranking.reasoning:
        print(f"<{ranking.ranker}>: {ranking.reasoning}\n")
    print(decision)
    bill = told(ranking.usage, ranking.ranker, prices)
    if bill:
        print(f"  cost: {bill}")
    if figure:
        print(f"  picture: {figure}")
    if page:
        print(f"  page: {page}")
    if written:
        print(f"  certificate: {written} (check it: sandra certificate check {written})")
    elif arguments.certificate:
        print("  certificate: none is written, what is executed has none")
    return 0


def _page(decision: Decision, arguments: argparse.Namespace) -> str | None:
    if arguments.report is None:
        return None
    from sandra.view.report import decision_document, write

    progress("page")
    document = decision_document(decision, vocabulary_of(arguments))
    written = str(write(document, arguments.report))
    progress("")
    return written


def _certificate(decision: Decision, path: str | None) -> str | None:
    if path is None or decision.certificate is None:
        return None
    from sandra.certificate import save

    return str(save(decision.certificate, path))
