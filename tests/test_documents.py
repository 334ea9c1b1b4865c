"""Every block of Python in the documents runs; every command in them parses."""

import re
import runpy
import shlex
from pathlib import Path

import pytest

from sandra.cli import _parser

ROOT = Path(__file__).resolve().parents[1]
DOCUMENTS = [*ROOT.glob("*.md"), *sorted((ROOT / "docs").glob("*.md"))]


FENCE = re.compile(r"^```(\w*)\n(.*?)^```$", flags=re.DOTALL | re.MULTILINE)


def blocks(language: str) -> list[tuple[str, str]]:
    found = []
    for path in DOCUMENTS:
        for i, (kind, block) in enumerate(FENCE.findall(path.read_text(encoding="utf-8"))):
            if kind == language:
                found.append((f"{path.name}-{i}", block))
    return found


@pytest.mark.parametrize(("name", "code"), blocks("python"), ids=[n for n, _ in blocks("python")])
def test_python_blocks_run(
    name: str, code: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    script = tmp_path / "block.py"
    script.write_text(code, encoding="utf-8")
    runpy.run_path(str(script), run_name="__main__")


def commands() -> list[str]:
    lines = [line for _, block in blocks("") for line in block.splitlines()]
    return [line for line in lines if line.startswith("sandra ")]


@pytest.mark.parametrize("line", commands())
def test_commands_parse(line: str) -> None:
    words = shlex.split(line.partition("#")[0])[1:]
    assert _parser().parse_args(words).command == words[0]


def test_there_are_blocks() -> None:
    assert len(blocks("python")) >= 5
    assert len(commands()) >= 5
