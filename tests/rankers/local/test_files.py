"""Files of models: what is written, what is refused, and how a process ends."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from sandra.describe import Prompt
from sandra.errors import RankerError
from sandra.rankers import Failure, create
from sandra.rankers.local import llama
from sandra.rankers.local.export import to_gguf
from tiny_model import prompts


def test_the_exported_file_answers_as_the_folder_does(tiny: Path) -> None:
    """Weights, tokens and template went along: greedy answers are the same, word for word."""
    gguf = create(f"gguf:{tiny}/model.gguf#threads=1")
    hf = create(f"hf:{tiny}/model#device=cpu")
    asked = prompts(9, 6)
    same = [gguf.rank(p, 60.0).answer == hf.rank(p, 60.0).answer for p in asked]
    assert sum(same) >= 5  # in a near tie rounding decides


def test_the_vocabulary_is_read_as_it_was_written(tiny: Path) -> None:
    """llama.cpp counts as many tokens in a prompt as the tokenizer of the folder."""
    from sandra.rankers.local.folder import folder

    model = folder(tiny / "model", device="cpu")
    server = llama.llama(str(tiny / "model.gguf"), threads=1)._server
    for prompt in prompts(9, 3):
        messages = [{"role": "system", "content": prompt.system}]
        messages += [{"role": "user", "content": prompt.user + " \u00e9\U0001f697 12,5 km/h\n\n"}]
        body = {"messages": messages, "max_tokens": 1}
        told = server.handle_chat_completions(body)["usage"]["prompt_tokens"]
        assert told == len(model.tokens_of(model.text_of(messages)))


@pytest.mark.parametrize("changes", [{"model_type": "llama"}, None])
def test_only_what_can_be_exported_is(tiny: Path, tmp_path: Path, changes: object) -> None:
    folder = tmp_path / "model"
    if changes is not None:
        shutil.copytree(tiny / "model", folder)
        config = json.loads((folder / "config.json").read_text())
        (folder / "config.json").write_text(json.dumps({**config, **changes}))  # type: ignore[dict-item]
    with pytest.raises(RankerError, match=r"convert_hf_to_gguf|no model that can be read"):
        to_gguf(folder, tmp_path / "model.gguf")


@pytest.mark.parametrize(
    ("spec", "message"),
    [
        ("gguf:", "no model named"),
        ("gguf:{here}/none.gguf", "No such file"),
        ("gguf:{here}", "Is a directory"),
        ("gguf:{here}/text.gguf", "is no GGUF file"),
        ("gguf:{here}/broken.gguf", "llama.cpp cannot load"),
        ("gguf:{tiny}/model.gguf#threads=0", "at least 1"),
        ("gguf:{tiny}/model.gguf#threads=many", "write an integer"),
        ("gguf:{tiny}/model.gguf#speed=9", "with one of threads, context"),
        ("hf:{here}", "no folder with a file config.json"),
        ("hf:Qwen/Qwen3-0.6B", "no folder with a file config.json"),
        ("hf:{here}/broken", "cannot be loaded"),
        ("hf:{tiny}/model+{here}", "no folder with a file adapter_config.json"),
        ("hf:{tiny}/model#mode=guess", "choose from generate, score"),
        ("hf:{tiny}/model#device=abacus", "cannot be loaded"),
        ("hf:{here}/mute", "chat template"),
    ],
)
def test_what_cannot_be_used_is_said_in_one_line(
    tiny: Path, tmp_path: Path, spec: str, message: str
) -> None:
    (tmp_path / "text.gguf").write_text("no model")
    (tmp_path / "broken.gguf").write_bytes(b"GGUF" + bytes(range(200)))
    (tmp_path / "broken").mkdir()
    (tmp_path / "broken" / "config.json").write_text("{}")
    shutil.copytree(tiny / "model", tmp_path / "mute")
    (tmp_path / "mute" / "chat_template.jinja").unlink()
    with pytest.raises(RankerError, match=message) as caught:
        create(spec.replace("{here}", str(tmp_path)).replace("{tiny}", str(tiny)))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("name", ["xllamacpp", "torch", "transformers", "llguidance"])
def test_a_package_that_is_missing_is_named_with_its_cure(
    tiny: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    monkeypatch.setitem(sys.modules, name, None)
    shutil.copy(tiny / "model.gguf", tmp_path)  # another file: it is not loaded yet
    shutil.copytree(tiny / "model", tmp_path / "model")
    spec = f"gguf:{tmp_path}/model.gguf" if name == "xllamacpp" else f"hf:{tmp_path}/model"
    with pytest.raises(RankerError, match=rf"'{name}'.*pip install 'sandra\[local\]'"):
        create(spec)


def test_a_model_is_loaded_once_and_anew_when_its_file_changes(tiny: Path, tmp_path: Path) -> None:
    file = tmp_path / "model.gguf"
    shutil.copy(tiny / "model.gguf", file)
    first = llama.llama(str(file), threads=1)
    assert llama.llama(str(file), threads=1) is first
    shutil.copyfile(tiny / "model.gguf", file)
    assert llama.llama(str(file), threads=1) is not first


def test_a_prompt_that_is_too_long_is_a_named_failure(tiny: Path) -> None:
    small: Prompt = prompts(9, 1)[0]
    ranking = create(f"gguf:{tiny}/model.gguf#threads=1&context=256").rank(small, 30.0)
    assert ranking.failure is Failure.REJECTED
    assert "context" in (ranking.detail or "")


LEAVES = """
import sys
sys.path.insert(0, sys.argv[2])
from dataclasses import replace
from sandra.rankers import create
from sandra.rankers.local import folder, llama
from tiny_model import prompts

folder.BATCH = llama.BATCH = 4000  # the model is small: so it is long at work with one

ranker = create(sys.argv[1])
prompt = prompts(9, 1)[0]
prompt = replace(prompt, user=prompt.user * 3)
print(ranker.rank(prompt, 0.03).failure.value, flush=True)
"""


@pytest.mark.parametrize("spec", ["gguf:{tiny}/model.gguf#threads=1", "hf:{tiny}/model#device=cpu"])
def test_a_process_ends_well_while_a_model_is_still_reading(tiny: Path, spec: str) -> None:
    """Native code that is at work while Python is taken down would end it with a signal."""
    tests = str(Path(__file__).resolve().parents[2])
    done = subprocess.run(
        [sys.executable, "-c", LEAVES, spec.replace("{tiny}", str(tiny)), tests],
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert (done.returncode, done.stdout.strip()) == (0, "timeout"), done.stderr


def test_nothing_heavy_is_imported_unless_it_is_used() -> None:
    heavy = "torch", "transformers", "xllamacpp", "gguf", "llguidance", "peft"
    code = f"""
import sys, sandra, sandra.rankers, sandra.cli
from sandra.rankers import create
create("rules")
try:
    sandra.cli.main(["decide", "--help"])
except SystemExit:
    pass
print([name for name in {heavy!r} if name in sys.modules], file=sys.stderr)
"""
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, timeout=60, check=True
    )
    assert done.stderr.strip() == "[]"


def test_the_port_that_comes_along_is_closed_to_others(tiny: Path) -> None:
    """llama.cpp listens on loopback even in this process; without our key it answers nobody."""
    import httpx2

    address = llama.llama(str(tiny / "model.gguf"), threads=1)._server.listening_address
    body = {"messages": [{"role": "user", "content": "hello"}], "max_tokens": 1}
    assert httpx2.post(f"{address}/v1/chat/completions", json=body, timeout=30.0).status_code == 401
