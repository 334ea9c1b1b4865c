"""The directive `{commands}`: the help of every command, from the parser that reads them."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from typing import Any

from docutils import nodes
from sphinx.util.docutils import SphinxDirective


def parsers(parser: argparse.ArgumentParser) -> Iterator[tuple[str, argparse.ArgumentParser]]:
    """(name, parser) of every command that does something, in their order."""
    groups = [a for a in parser._actions if isinstance(a, argparse._SubParsersAction)]
    if not groups:
        yield parser.prog, parser
    for group in groups:
        for each in group.choices.values():
            yield from parsers(each)


class Commands(SphinxDirective):
    """One section for each command."""

    def run(self) -> list[nodes.Node]:
        """Its help as it is printed, 90 columns wide."""
        from sandra.cli import _parser

        sections: list[nodes.Node] = []
        for name, parser in parsers(_parser()):
            parser.formatter_class = _wide(parser.formatter_class)
            section = nodes.section(ids=[nodes.make_id(name)], names=[name])
            section += nodes.title(text=name)
            section += nodes.literal_block(text=parser.format_help(), language="none")
            sections.append(section)
        return sections


def _wide(base: Any) -> Any:
    return lambda prog: base(prog, width=90)


def setup(app: Any) -> dict[str, Any]:
    """Register the directive."""
    app.add_directive("commands", Commands)
    return {"parallel_read_safe": True}
