"""Every block of Python in the documents runs; every command parses; those about models run."""

import json
import re
import runpy
import shlex
from pathlib import Path

import pytest

from sandra.cli import _parser, main

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


def commands(document: str = "") -> list[str]:
    found = [block for name, block in blocks("") if name.startswith(document)]
    lines = [line for block in found for line in block.splitlines()]
    return [line for line in lines if line.startswith("sandra ")]


def words_of(line: str) -> list[str]:
    """As a shell splits it, where a comment begins after a blank."""
    return shlex.split(re.sub(r"\s#.*", "", line))[1:]


@pytest.mark.parametrize(("name", "code"), blocks("python"), ids=[n for n, _ in blocks("python")])
def test_python_blocks_run(
    name: str,
    code: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    request: pytest.FixtureRequest,
) -> None:
    monkeypatch.chdir(tmp_path)
    if name.startswith("models.md"):
        request.getfixturevalue("bring_models")
    script = tmp_path / "block.py"
    script.write_text(code, encoding="utf-8")
    runpy.run_path(str(script), run_name="__main__")


@pytest.fixture
def bring_models(
    tiny: Path, llama_server: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The models that docs/models.md speaks of, under the names that it gives them."""
    for name, what in (("my-model", "model"), ("my-adapter", "adapter"), ("model.gguf",) * 2):
        (tmp_path / name).symlink_to(tiny / what)
    for server in ("OPENAI", "OLLAMA", "VLLM"):
        monkeypatch.setenv(f"{server}_BASE_URL", llama_server)
        monkeypatch.delenv(f"{server}_API_KEY", raising=False)
    monkeypatch.chdir(tmp_path)


@pytest.mark.parametrize("line", commands("models.md"))
@pytest.mark.usefixtures("bring_models")
def test_commands_about_models_get_a_ranking(
    line: str, capsys: pytest.CaptureFixture[str], llama_server: str
) -> None:
    words = words_of(line)
    if "--base-url" in words:
        words[words.index("--base-url") + 1] = llama_server
    assert main([*words, "--horizon", "6", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    # That server's /responses ignores the schema, so that anything may come.
    assert told["failure"] is None or "api=responses" in line
    assert told["ranking"] or told["failure"]


@pytest.mark.parametrize("line", commands())
def test_commands_parse(line: str) -> None:
    words = words_of(line)
    assert _parser().parse_args(words).command == words[0]


def test_there_are_blocks() -> None:
    assert len(blocks("python")) >= 5
    assert len(commands()) >= 5
