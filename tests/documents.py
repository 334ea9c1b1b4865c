"""The fenced blocks of the documents, and what is done with each.

| fence | by the tests |
|---|---|
| `python` | run, all of a page in one namespace, unless it says why not |
| `bash` | each `sandra ...` is parsed and run with small settings; what is not run says so |
| `toml` | parsed |
| `text` | output or a drawing: holds no command, but after a `$` (parsed) |
| `{directive}` | of the site; `make docs` builds it |

What is not run ends, or begins its block, with a comment `# not run: REASON`.
"""

from __future__ import annotations

import argparse
import re
import shlex
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from sandra.cli import _parser

ROOT = Path(__file__).resolve().parents[1]
PAGES = [*sorted(ROOT.glob("*.md")), *sorted((ROOT / "docs").glob("*.md"))]
FENCE = re.compile(r"^( *)```([^\n`]*)\n(.*?)^\1```$", flags=re.DOTALL | re.MULTILINE)
NOT_RUN = re.compile(r"#\s*not run: (\w.*)")
COMMAND = re.compile(r"\s*(sandra|make|pip|python3?|export|git|uv) ")
KINDS = ("python", "bash", "toml", "text")
SERVES = ("view",)
"""Commands that go on until they are stopped: nobody may run them here."""


@dataclass(frozen=True, slots=True)
class Block:
    """One fenced block."""

    page: str
    """Of the file, from the project's root."""
    line: int
    """Of the fence."""
    kind: str
    text: str

    def __str__(self) -> str:
        return f"{self.page}:{self.line}"

    @property
    def lines(self) -> list[str]:
        """Those that say something, with what a backslash joins put together."""
        joined = self.text.replace("\\\n", " ")
        return [line for line in joined.splitlines() if line.strip()]

    @property
    def reason(self) -> str | None:
        """Why nothing of the block is run: its first line says so."""
        first = self.lines[0] if self.lines else ""
        found = NOT_RUN.match(first.strip())
        return found.group(1) if found else None


def blocks_of(page: str, text: str) -> list[Block]:
    """The fenced blocks of a page."""
    return [
        Block(page, text[: m.start()].count("\n") + 1, m.group(2).strip(), m.group(3))
        for m in FENCE.finditer(text)
    ]


BLOCKS = [
    block
    for path in PAGES
    for block in blocks_of(str(path.relative_to(ROOT)), path.read_text(encoding="utf-8"))
]


@dataclass(frozen=True, slots=True)
class Line:
    """One command of a `bash` block."""

    block: Block
    text: str
    reason: str | None
    """Why it is not run; None: it is."""

    @property
    def words(self) -> list[str]:
        """As a shell splits it, where a comment begins after a blank."""
        return shlex.split(re.sub(r"(^|\s)#.*", "", self.text))


def lines_of(block: Block) -> list[Line]:
    """The commands of a `bash` block."""
    found = []
    for text in block.lines:
        if text.lstrip().startswith("#"):
            continue
        marked = NOT_RUN.search(text)
        found.append(Line(block, text, marked.group(1) if marked else block.reason))
    return found


LINES = [line for block in BLOCKS if block.kind == "bash" for line in lines_of(block)]


def faults(block: Block) -> list[str]:
    """What is wrong with a block: nobody runs it and it does not say why."""
    if block.kind.startswith("{"):
        return []
    if block.kind not in KINDS:
        return [f"{block}: a fence is one of {', '.join(KINDS)}, not '{block.kind}'"]
    if block.kind == "text":
        commands = [text for text in block.lines if COMMAND.match(text)]
        return [f"{block}: '{text}' is a command; fence it as bash" for text in commands]
    if block.kind == "bash":
        return [
            f"{block}: '{line.text}' is run by nobody; say why: # not run: ..."
            for line in lines_of(block)
            if line.reason is None and (line.words[:1] != ["sandra"] or line.words[1] in SERVES)
        ]
    return []


FEW: dict[str, tuple[str, ...]] = {
    "decide": ("--horizon", "6"),
    "verify": ("--horizon", "6"),
    "drive": ("--seeds", "5838", "--steps", "2", "--workers", "1"),
    "label": ("--windows", "1", "--ego", "given", "--workers", "1"),
    "conformance": ("--workers", "1"),
    "evaluate verdicts": ("--horizon", "6", "--predictions", "most-likely", "--workers", "1"),
    "evaluate soundness": ("--rollouts", "1", "--per-certificate", "1", "--workers", "1"),
    "evaluate open-loop": ("--horizon", "5", "--windows", "1", "--ego", "given", "--workers", "1"),
    "evaluate closed-loop": ("--rows", "slower", "--settings", "1", "--workers", "1"),
    "dataset record": ("--episodes", "3", "--duration", "2", "--workers", "1"),
    "figure set": ("--horizon", "6"),
    "figure maneuver": ("--horizon", "6"),
    "figure predictions": ("--horizon", "6"),
    "dataset build": ("--horizon", "3", "--vehicles", "2", "--windows", "1"),
    "finetune scratch": ("--steps", "1", "--width", "64", "--layers", "1", "--batch", "2"),
    "finetune lora": ("--epochs", "0.5", "--rank", "2", "--measure", "1"),
    "finetune openai": ("--every", "0.01"),
    "bench decide": ("--runs", "1"),
    "bench reach": ("--horizons", "5", "--runs", "1", "--no-peer"),
    "bench growth": ("--axes", "lanes", "--runs", "1"),
}
"""What is appended to a command, so that it is quick: of repeated options the last one counts."""


def small(words: Sequence[str], server: str) -> list[str]:
    """The command (without `sandra`), quick, and asking the server on loopback."""
    name = next((n for n in FEW if list(words[: len(n.split())]) == n.split()), "")
    told = [word for word in words if word != "--paper-seeds"]
    told += FEW.get(name, ())
    if name.startswith("finetune"):
        told = ["rows.jsonl" if word == "data.jsonl" else word for word in told]
    if name == "evaluate closed-loop":
        # Runs that differ belong into different folders.
        folder = "-".join(word for word in ("paper", "--base-url") if word in words)
        told += ["--seeds", "5838", "--out", f"runs/rows{folder}"]
    if name == "evaluate soundness":
        told = [word for word in told if not word.endswith(".xml")] + ["merge"]
    if any(word.startswith("dilu:") for word in words):
        told += ["--deadline", "1"]
    if "--base-url" in told:
        told[told.index("--base-url") + 1] = server
    return told


def parsed(words: Sequence[str]) -> argparse.Namespace:
    """What the command line's own parser makes of a command (without `sandra`).

    Raises:
        SystemExit: if it refuses it.
    """
    return _parser().parse_args(list(words))
