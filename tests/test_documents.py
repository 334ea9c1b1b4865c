"""Every block of the documents is run, or says visibly why not; see `documents`."""

from __future__ import annotations

import json
import re
import shutil
import tomllib
from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest

import sandra
from documents import BLOCKS, LINES, ROOT, Line, blocks_of, faults, parsed, small
from sandra.cli import main
from sandra.scene.writing import write
from tuning_rows import row
from tuning_server import tuning_server

PYTHON = list(dict.fromkeys(b.page for b in BLOCKS if b.kind == "python"))
RUN = [line for line in LINES if line.reason is None]
SHELL = list(dict.fromkeys(line.block.page for line in RUN))
EXPORTS = re.compile(r"\$ (sandra .*)")


def test_no_block_is_without_a_reason() -> None:
    assert [fault for block in BLOCKS for fault in faults(block)] == []
    assert len(BLOCKS) > 60
    assert Counter(block.kind for block in BLOCKS)["python"] >= 15


def test_most_commands_are_run() -> None:
    ours = [line for line in LINES if line.words[0] == "sandra"]
    assert len(ours) > 70
    left = [f"{line.block}: {line.text}" for line in ours if line.reason is not None]
    assert len(left) <= len(ours) / 10, left


@pytest.mark.parametrize(
    ("page", "fault"),
    [
        ("```bash\nmake coffee\n```", "run by nobody"),
        ("```bash\nmake coffee  # not run: \n```", "run by nobody"),
        ("```bash\nmake coffee  # minutes\n```", "run by nobody"),
        ("```bash\nsandra view\n```", "run by nobody"),
        ("```\nsandra decide merge\n```", "a fence is one of"),
        ("```text\nsandra decide merge\n```", "is a command"),
        ("```bash\n# not run: no beans\nmake coffee\n```", None),
        ("```bash\nmake coffee  # not run: no beans\n```", None),
    ],
)
def test_a_block_without_a_reason_is_found(page: str, fault: str | None) -> None:
    (block,) = blocks_of("page.md", page)
    found = faults(block)
    assert (fault is None and found == []) or (fault is not None and fault in found[0])


def test_commands_parse() -> None:
    shown = [m.group(1) for b in BLOCKS if b.kind == "text" for m in EXPORTS.finditer(b.text)]
    assert len(shown) >= 1
    told = [Line(BLOCKS[0], text, None) for text in shown] + LINES
    for line in told:
        if line.words[0] == "sandra":
            assert parsed(line.words[1:]).command == line.words[1], line.text


def test_targets_exist() -> None:
    targets = set(re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text("utf-8"), re.MULTILINE))
    named = {line.words[1] for line in LINES if line.words[0] == "make"}
    assert named <= targets


def test_scripts_exist() -> None:
    named = [w for line in LINES if "python" in line.words[0] for w in line.words if ".py" in w]
    assert len(named) >= 3
    assert [name for name in named if not (ROOT / name).is_file()] == []


@pytest.mark.parametrize("block", [b for b in BLOCKS if b.kind == "toml"], ids=str)
def test_toml_parses(block) -> None:
    assert tomllib.loads(block.text)


@pytest.mark.parametrize("page", PYTHON)
def test_python_blocks_run(
    page: str, desk: Path, monkeypatch: pytest.MonkeyPatch, request: pytest.FixtureRequest
) -> None:
    monkeypatch.chdir(desk)
    namespace = {"__name__": "__main__"}
    for block in BLOCKS:
        if block.page == page and block.kind == "python" and block.reason is None:
            if re.search(r'"(openai|gguf|hf):|my-model', block.text):
                request.getfixturevalue("models")
            code = "\n" * block.line + block.text
            exec(compile(code, str(ROOT / page), "exec"), namespace)


@pytest.mark.parametrize("page", SHELL)
def test_commands_run(
    page: str,
    desk: Path,
    models: str,
    provider: str,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(desk)
    monkeypatch.syspath_prepend(str(desk))
    for line in RUN:
        if line.block.page != page:
            continue
        words = small(line.words[1:], models)
        if words[:2] == ["finetune", "openai"]:
            words += ["--base-url", provider, "--yes"]
        if (key := str(sorted(vars(parsed(words)).items(), key=str))) in DONE:
            continue
        if page == "docs/models.md":
            words.append("--json")
        status = main(words)
        out, err = capsys.readouterr()
        # 1 is a negative answer of commands that give one.
        assert status in (0, 1), f"{line.block}: {line.text}: {err}"
        assert status == 0 or words[0] not in ("decide", "prompt", "film", "dataset"), line.text
        if page == "docs/models.md":
            told = json.loads(out)
            # That server's /responses ignores the schema, so that anything may come.
            assert told["failure"] is None or "api=responses" in line.text
            assert told["ranking"] or told["failure"]
        DONE.add(key)


DONE: set[str] = set()
"""Commands that were run in this process, on its desk."""


@pytest.fixture(scope="module")
def desk(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the files that the documents speak of, under the names that they use."""
    desk = tmp_path_factory.mktemp("desk")
    for name in ("SCENARIO.xml", "my_scenario.xml", "DEU_Goeppingen-37_1_T-4.xml"):
        shutil.copy(sandra.example("intersection"), desk / name)
    scene = sandra.load(sandra.example("recorded-ego"))
    assert scene.recorded_ego is not None
    write(replace(scene, recorded_ego=scene.recorded_ego[:22]), desk / "RECORDING.xml")
    for folder in ("FOLDER", "recordings", "scenarios", "scenarios/highd", "src/sandra/scenarios"):
        (desk / folder).mkdir(parents=True)
        quick = "nothing-safe" if folder.endswith("scenarios") else "recorded-ego"
        shutil.copy(sandra.example(quick), desk / folder)
    (desk / "src" / "sandra" / "rankers").symlink_to(ROOT / "src" / "sandra" / "rankers")
    header = "scenario_id,label_lon,label_lat,lon1,lat1,lon2,lat2,safe_top1,safe_top2\n"
    told = "one,keep,follow-lane,keep,follow-lane,accelerate,follow-lane,1,1\n"
    (desk / "RANKINGS.csv").write_text(header + told)
    (desk / "VERDICTS.csv").write_text("scenario_id,lon,lat,safe\none,keep,follow-lane,1\n")
    rows = [row(i, "train" if i < 12 else "validation") for i in range(14)]
    (desk / "rows.jsonl").write_text("".join(each.line() for each in rows))
    (desk / "prices.toml").write_text('["openai:MODEL"]\ninput = 1.0\noutput = 2.0\n')
    return desk


@pytest.fixture(scope="module")
def provider() -> Iterator[str]:
    """The address of a provider that tunes, on loopback."""
    with tuning_server() as server:
        server.key, server.models = None, {"MODEL"}
        yield server.url


@pytest.fixture
def models(tiny: Path, llama_server: str, desk: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    """The models that the documents speak of, under the names that they give them."""
    for name, what in (("my-model", "model"), ("my-adapter", "adapter"), ("model.gguf",) * 2):
        if not (desk / name).exists():
            (desk / name).symlink_to(tiny / what)
    for server in ("OPENAI", "OLLAMA", "VLLM"):
        monkeypatch.setenv(f"{server}_BASE_URL", llama_server)
        monkeypatch.delenv(f"{server}_API_KEY", raising=False)
    return llama_server
