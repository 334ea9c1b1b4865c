"""`sandra prompt`: what a model would be told."""

from __future__ import annotations

import argparse
import json
from typing import Any

from sandra.cli.options import add_prompting, add_scenario, command, past_of, scene_of, settings_of
from sandra.cli.output import print_json


def add(commands: Any) -> None:
    parser = command(
        commands,
        "prompt",
        "print the exact prompt, and the JSON schema of the answer",
        "sandra prompt intersection --command 'drive faster'",
    )
    add_scenario(parser)
    add_prompting(parser)
    parser.add_argument("--rules", default="", metavar="LIST", help="rules for --rule-prompt")
    parser.set_defaults(run=_prompt)


def _prompt(arguments: argparse.Namespace) -> int:
    from sandra.describe import describe, render
    from sandra.logic import parse_rules

    settings = settings_of(arguments)
    if arguments.k is not None:
        settings = settings.replace(k=arguments.k)
    prompt = describe(
        scene_of(arguments, settings),
        arguments.wish,
        past_of(arguments.past),
        rules=parse_rules(arguments.rules),
        rule_prompt=arguments.rule_prompt,
        settings=settings,
    )
    if arguments.json:
        print_json({"system": prompt.system, "user": prompt.user, "schema": prompt.schema})
    else:
        print(render(prompt))
        print()
        print(json.dumps(prompt.schema, indent=2))
    return 0
