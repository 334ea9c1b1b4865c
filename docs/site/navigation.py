"""The order of the pages, in one place; those that do not exist (yet) are left out.

The pages themselves hold no directives, so that they read the same on a forge. A page that is in
no group is put into the last one.
"""

from __future__ import annotations

from typing import Any

GROUPS = {
    "Start": ("tutorial", "notebooks/decide", "scenarios"),
    "Concepts": ("concepts", "method", "prompt", "rankers", "monitor"),
    "How to": (
        "own-ranker", "models", "embedded", "finetune", "own-rule", "own-prediction", "planner",
        "own-simulator", "shield", "drive", "own-data", "dataset", "notebooks/evaluate", "cluster",
        "report", "figures",
    ),
    "What was measured": (
        "safe", "soundness", "differential", "verdicts", "mutation", "conformance", "closed-loop",
        "open-loop", "dilu", "case-study", "benchmarks",
    ),
    "Plainly": ("differences", "limits"),
    "Reference": ("cli", "api", "/CONTRIBUTING", "/CHANGELOG"),
}  # fmt: skip
REST = "More"


def _tree(caption: str, pages: list[str]) -> str:
    return "\n".join(
        ["", "```{toctree}", ":hidden:", f":caption: {caption}", "", *pages, "```", ""]
    )


def add_trees(app: Any, page: str, source: list[str]) -> None:
    """Append the tables of contents to the home page."""
    if page != app.config.root_doc:
        return
    known = set(app.env.found_docs)
    named = {
        each: each[1:] if each[0] == "/" else f"docs/{each}" for g in GROUPS.values() for each in g
    }
    groups = {name: [p for p in pages if named[p] in known] for name, pages in GROUPS.items()}
    groups[REST] = [f"/{p}" for p in sorted(known - set(named.values()) - {page})]
    source[0] += "".join(_tree(name, pages) for name, pages in groups.items() if pages)


def setup(app: Any) -> dict[str, Any]:
    """Listen to pages being read."""
    app.connect("source-read", add_trees)
    return {"parallel_read_safe": True}
