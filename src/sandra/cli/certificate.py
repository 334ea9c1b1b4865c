"""`sandra certificate check`: the independent checker."""

from __future__ import annotations

import argparse
from typing import Any

from sandra.cli.options import command
from sandra.cli.output import print_json


def add(commands: Any) -> None:
    parser = command(
        commands,
        "certificate",
        "check a certificate with code that neither planned nor verified it",
        "sandra certificate check certificate.json",
    )
    actions = parser.add_subparsers(dest="action", metavar="ACTION", required=True)
    check = command(
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
        print_json(report.to_dict())
    else:
        print(report)
    return 0 if report.accepted else 1
