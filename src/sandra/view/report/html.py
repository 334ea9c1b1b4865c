"""From a document to one HTML file that needs no network, and lets nothing in it run but its own.

What came from a model or a file is only ever text: it travels as JSON in a block that is no
script, and the page puts it into text nodes. The policy in the page's head admits one script and
one style sheet, by their hashes, pictures that are in the page, and no request to anywhere.
"""

from __future__ import annotations

import base64
import hashlib
import json
import re
from collections.abc import Mapping
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Any

from sandra.errors import SandraError
from sandra.view.report.document import Document
from sandra.view.report.theme import css

_LIVE = "live-"


def write(document: Document, path: str | Path) -> Path:
    """Write the page of a document.

    Raises:
        SandraError: if the file cannot be written.
    """
    where = Path(path)
    text = page(document)
    try:
        where.write_text(text, encoding="utf-8")
    except OSError as error:
        raise SandraError(f"{where}: cannot be written ({error.strerror or error})") from None
    return where


def page(document: Document, *, live: Mapping[str, Any] | None = None) -> str:
    """The page's HTML; `live`: what it needs for talking to the server that it comes from."""
    style, script = style_sheet(), scripts(live is not None)
    data = document.to_dict() | ({} if live is None else {"live": dict(live)})
    sources = {
        "default-src": "'none'",
        "script-src": f"'{_hash(script)}'",
        "style-src": f"'{_hash(style)}'",
        "img-src": "data:",
        "base-uri": "'none'",
        "form-action": "'none'",
    }
    if live is not None:
        sources["connect-src"] = "'self'"
    filled = {
        "policy": "; ".join(f"{name} {value}" for name, value in sources.items()),
        "title": _escaped(document.title[:200]),
        "style": style,
        "script": script,
        "document": in_script(json.dumps(data, allow_nan=False, ensure_ascii=False)),
    }
    # Split first: what is filled in is not searched for further marks.
    parts = re.split(r"\{\{(\w+)\}\}", _asset("template.html"))
    return "".join(filled[x] if i % 2 else x for i, x in enumerate(parts))


def in_script(text: str) -> str:
    """JSON that no HTML parser takes for a tag: <, > and & only occur within strings there."""
    for character in "<>&\u2028\u2029":
        text = text.replace(character, f"\\u{ord(character):04x}")
    # A lone half of a surrogate pair cannot be written as UTF-8.
    return text.encode("utf-8", "backslashreplace").decode("utf-8")


@cache
def style_sheet() -> str:
    """All style sheets after one another, the variables first."""
    return css() + "".join(_asset(name) for name in _assets(".css"))


@cache
def scripts(live: bool) -> str:
    """All scripts after one another, in one scope that nothing else can reach."""
    names = [name for name in _assets(".js") if live or _LIVE not in name]
    body = "\n".join(_asset(name) for name in names)
    return f'(() => {{\n"use strict";\n{body}\n}})();\n'


def _assets(ending: str) -> list[str]:
    """Names in the order in which they belong after one another: they begin with a number."""
    folder = files("sandra.view.report") / "page"
    return sorted(x.name for x in folder.iterdir() if x.name.endswith(ending))


def _asset(name: str) -> str:
    return (files("sandra.view.report") / "page" / name).read_text(encoding="utf-8")


def _hash(text: str) -> str:
    return "sha256-" + base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()


def _escaped(text: str) -> str:
    return text.replace("&", "&amp;").replace("<", "&lt;").replace(">", "&gt;")
