"""`sandra prompt`: what a model would be told."""

from __future__ import annotations

import argparse
from typing import Any

from sandra.cli.options import add_prompting, add_scenario, command, past_of, scene_of, settings_of
from sandra.cli.output import print_json
from sandra.cli.prompting import add_context, prompt_options_of, save_picture


class _ListTemplates(argparse.Action):
    def __call__(self, parser: argparse.ArgumentParser, *_rest: Any) -> None:
        from sandra.describe.templates import our_text

        print(our_text(), end="")
        parser.exit()


def add(commands: Any) -> None:
    parser = command(
        commands,
        "prompt",
        "print the exact prompt, and the JSON schema of the answer",
        "sandra prompt intersection --command 'drive faster'",
        "sandra prompt intersection --vision ego --picture look.png --measures all "
        "--weather 'light rain' --obstacles beams",
    )
    add_scenario(parser)
    add_prompting(parser)
    parser.add_argument("--rules", default="", metavar="LIST", help="rules for --rule-prompt")
    add_context(parser)
    parser.add_argument(
        "--list-templates",
        nargs=0,
        action=_ListTemplates,
        default=argparse.SUPPRESS,
        help="print our sentences as a file for --templates, no more",
    )
    parser.set_defaults(run=_prompt)


def _prompt(arguments: argparse.Namespace) -> int:
    from sandra.describe import describe, render
    from sandra.describe.tokens import tokens
    from sandra.logic import parse_rules

    settings = settings_of(arguments)
    if arguments.k is not None:
        settings = settings.replace(k=arguments.k)
    scene = scene_of(arguments, settings)
    prompt = describe(
        scene,
        arguments.wish,
        past_of(arguments.past),
        rules=parse_rules(arguments.rules),
        rule_prompt=arguments.rule_prompt,
        settings=settings,
        options=prompt_options_of(arguments, scene),
    )
    written = save_picture(prompt, arguments.picture)
    length = tokens(prompt)
    if arguments.json:
        data = {"system": prompt.system, "user": prompt.user, "schema": prompt.schema}
        if prompt.picture is not None:
            data["picture"] = prompt.picture.data_url
        counted = {"text": length.text, "schema": length.schema, "picture": length.picture}
        print_json({**data, "tokens": counted})
    else:
        print(f"{render(prompt)}\n{length}")
        if written:
            print(f"picture: {written}")
    return 0
