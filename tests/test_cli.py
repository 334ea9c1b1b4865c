"""The command line as a user meets it: real processes for what matters, `main` for the rest."""

import json
import os
import re
import subprocess
import sys
from importlib import import_module
from pathlib import Path

import pytest

from sandra.cli import main
from sandra.reach import Ground
from sandra.scenarios import examples

NAMES = {"keep", "accelerate", "decelerate", "stop", "follow-lane", "left-lane", "right-lane"}
SCENARIO = "intersection"


def run(*words: str, **environment: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "sandra.cli", *words],
        capture_output=True,
        text=True,
        timeout=120,
        env={**os.environ, **environment},
        check=False,
    )


@pytest.fixture
def source() -> str:
    return examples()[SCENARIO].read_text(encoding="utf-8")


def write(folder: Path, text: str, name: str = "scenario.xml") -> str:
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return str(path)


def refused(capsys: pytest.CaptureFixture[str], *words: str) -> str:
    """The one line of an error with exit status 2."""
    try:
        status = main(words)
    except SystemExit as stop:
        status = int(stop.code or 0)
    output = capsys.readouterr()
    assert status == 2, output
    assert output.out == ""
    lines = output.err.strip().splitlines()
    assert len(lines) == 1, output.err
    assert "Traceback" not in output.err
    return lines[0]


def test_verify_all_json_is_one_object_with_twelve_verdicts(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert main(["verify", SCENARIO, "--all", "--json"]) == 0
    verdicts = json.loads(capsys.readouterr().out)["verdicts"]
    assert len({(v["longitudinal"], v["lateral"]) for v in verdicts}) == 12
    for verdict in verdicts:
        assert {verdict["longitudinal"], verdict["lateral"]} <= NAMES
        assert verdict["status"] in ("UNSAFE", "REACHABLE", "CERTIFIED")
        assert (verdict["status"] == "UNSAFE") == (verdict["first_empty_step"] is not None)
        assert (verdict["status"] == "UNSAFE") == (verdict["reason"] is not None)
        assert verdict["duration_s"] > 0


def test_verify_with_the_precision_asked_for(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    used: list[str] = []
    module = import_module("sandra.reach.verify")
    original = module.problem_of

    def spy(base: Ground, *rest: object) -> object:
        used.append(base.settings.precision)
        return original(base, *rest)

    monkeypatch.setattr(module, "problem_of", spy)
    words = ("verify", SCENARIO, "--pair", "decelerate,follow-lane")
    assert main([*words, "--precision", "tight"]) == 0
    assert main([*words]) == 0
    capsys.readouterr()
    assert used == ["tight", "quick"]
    error = refused(capsys, *words, "--precision", "best")
    assert "precision = 'best': choose quick or tight" in error


def test_decide_json_keeps_the_contract(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["decide", SCENARIO, "--command", "drive faster", "--json"]) == 0
    data = json.loads(capsys.readouterr().out)
    assert data["ranker"] == "embedded"
    assert data["failure"] is None
    assert 1 <= len(data["ranking"]) <= 3
    assert set(data["durations_s"]) == {"describe", "rank", "predict", "verify", "plan", "total"}
    assert data["executed"]["kind"] in ("certified", "reachable", "fail-safe")
    ranked = [(p["longitudinal"], p["lateral"]) for p in data["ranking"]]
    verified = [(v["longitudinal"], v["lateral"]) for v in data["verdicts"]]
    assert verified == ranked
    holds = [v for v in data["verdicts"] if v["status"] != "UNSAFE"]
    accepted = [v for v in data["verdicts"] if v["status"] == "CERTIFIED"]
    assert len(accepted) <= len(holds)
    if accepted:
        assert data["executed"]["kind"] == "certified"
        assert data["executed"]["longitudinal"] == accepted[0]["longitudinal"]
        assert data["executed"]["lateral"] == accepted[0]["lateral"]
    else:
        assert data["executed"]["kind"] == "fail-safe"


def test_accept_reachable_executes_the_first_reachable_pair(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert main(["decide", SCENARIO, "--accept", "reachable", "--json"]) == 0
    data = json.loads(capsys.readouterr().out)
    holds = [v for v in data["verdicts"] if v["status"] == "REACHABLE"]
    assert data["executed"]["kind"] == "reachable"
    assert data["executed"]["longitudinal"] == holds[0]["longitudinal"]
    assert data["executed"]["lateral"] == holds[0]["lateral"]


def test_the_certificate_of_what_is_executed_is_accepted_by_the_checker(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "certificate.json"
    words = ["--ranker", "exhaustive", "--walk", "first", "--certificate", str(path), "--json"]
    assert main(["decide", SCENARIO, *words]) == 0
    data = json.loads(capsys.readouterr().out)
    assert data["executed"]["kind"] == "certified"
    assert data["certificate"] == str(path)
    statuses = {(v["longitudinal"], v["lateral"]): v["status"] for v in data["verdicts"]}
    executed = (data["executed"]["longitudinal"], data["executed"]["lateral"])
    assert statuses[executed] == "CERTIFIED"
    assert main(["certificate", "check", str(path), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["accepted"] is True
    path.write_text(path.read_text().replace('"decelerate"', '"accelerate"'))
    assert main(["certificate", "check", str(path)]) == 1
    assert "rejected" in capsys.readouterr().out
    path.write_text("{}")
    assert main(["certificate", "check", str(path)]) == 2


def test_decide_exits_0_also_when_the_fail_safe_is_chosen(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert main(["decide", "nothing-safe", "--walk", "all", "--json"]) == 0
    data = json.loads(capsys.readouterr().out)
    assert data["executed"] == {"kind": "fail-safe", "longitudinal": None, "lateral": None}
    assert len(data["verdicts"]) == 12
    assert {v["status"] for v in data["verdicts"]} == {"UNSAFE"}
    assert all(v["reason"] for v in data["verdicts"])


def test_modes(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["decide", SCENARIO, "--mode", "verify-first", "--json"]) == 0
    data = json.loads(capsys.readouterr().out)
    assert data["mode"] == "verify-first"
    assert len(data["verdicts"]) == 12
    ranked = data["verdicts"][: len(data["ranking"])]
    assert {v["status"] for v in ranked} == {"CERTIFIED"}
    assert main(["decide", SCENARIO, "--mode", "exhaustive", "--walk", "first"]) == 0
    assert "ranked by exhaustive" in capsys.readouterr().out


def test_verify_of_an_unsafe_pair_exits_1(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["verify", "nothing-safe", "--pair", "keep,follow-lane"]) == 1
    assert "UNSAFE" in capsys.readouterr().out


def test_verify_writes_the_corridor_of_a_pair(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "corridor.json"
    asked = ["verify", "intersection", "--pair", "decelerate,follow-lane"]
    assert main([*asked, "--corridor", str(file), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["corridor"] == str(file)
    data = json.loads(file.read_text(encoding="utf-8"))
    assert len(data["steps"]) == data["horizon"] + 1
    assert data["pair"] == {"longitudinal": "decelerate", "lateral": "follow-lane"}

    # A pair without a corridor, all pairs at once, a place that cannot be written.
    other = tmp_path / "none.json"
    unsafe = ["verify", "nothing-safe", "--pair", "keep,follow-lane"]
    assert main([*unsafe, "--corridor", str(other)]) == 1
    assert "none is written" in capsys.readouterr().out
    assert not other.exists()
    assert main(["verify", "intersection", "--all", "--corridor", str(other)]) == 2
    assert "--pair" in capsys.readouterr().err
    assert main([*asked, "--corridor", str(tmp_path)]) == 2
    assert "cannot be written" in capsys.readouterr().err


def test_prompt_prints_text_and_schema(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["prompt", SCENARIO, "--command", "drive faster", "--json"]) == 0
    data = json.loads(capsys.readouterr().out)
    assert "drive faster" in data["system"]
    assert data["schema"]["additionalProperties"] is False
    assert main(["prompt", SCENARIO]) == 0
    assert "follow-lane" in capsys.readouterr().out


def test_an_unreachable_server_is_a_named_failure_and_the_decision_goes_on(
    capsys: pytest.CaptureFixture[str],
) -> None:
    words = ["--ranker", "openai:any", "--base-url", "http://127.0.0.1:9/v1", "--deadline", "3"]
    assert main(["decide", SCENARIO, *words, "--json"]) == 0
    data = json.loads(capsys.readouterr().out)
    assert data["failure"] in ("unreachable", "timeout")
    assert data["ranking"] == []
    assert data["executed"]["kind"] == "fail-safe"


def test_the_picture_is_written(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    picture = tmp_path / "decision.png"
    assert main(["decide", SCENARIO, "--figure", str(picture)]) == 0
    assert picture.read_bytes().startswith(b"\x89PNG")
    assert str(picture) in capsys.readouterr().out


@pytest.mark.parametrize(
    "command", ["decide", "verify", "prompt", "certificate", "dataset", "scenarios", "demo"]
)
def test_every_command_has_an_example_in_its_help(
    command: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as stop:
        main([command, "--help"])
    assert stop.value.code == 0
    assert f"example: sandra {command}" in " ".join(capsys.readouterr().out.split())


def test_no_such_file(capsys: pytest.CaptureFixture[str]) -> None:
    assert "nowhere.xml" in refused(capsys, "decide", "nowhere.xml")


def test_a_folder(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    refused(capsys, "decide", str(tmp_path))


def test_not_xml(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    refused(capsys, "decide", write(tmp_path, "this is no scenario"))


def test_empty_file(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    refused(capsys, "decide", write(tmp_path, ""))


@pytest.mark.parametrize("share", [0.1, 0.5, 0.99])
def test_truncated_xml(
    share: float, tmp_path: Path, source: str, capsys: pytest.CaptureFixture[str]
) -> None:
    refused(capsys, "decide", write(tmp_path, source[: int(share * len(source))]))


def test_no_planning_problem(
    tmp_path: Path, source: str, capsys: pytest.CaptureFixture[str]
) -> None:
    text = re.sub(r"<planningProblem .*</planningProblem>", "", source, flags=re.DOTALL)
    assert text != source
    assert "planning problem" in refused(capsys, "decide", write(tmp_path, text))


def in_problem(source: str, tag: str, value: str) -> str:
    """The source with the exact value of a tag in the planning problem's initial state."""
    head, mark, tail = source.partition("<planningProblem ")
    pattern = rf"(<{tag}>\s*(?:<exact>|<point>\s*<x>))[^<]*"
    changed, count = re.subn(pattern, rf"\g<1>{value}", tail, count=1)
    assert count == 1
    return head + mark + changed


@pytest.mark.parametrize(
    ("tag", "value"),
    [
        ("position", "99999.0"),
        ("position", "NaN"),
        ("position", "inf"),
        ("velocity", "-3.0"),
        ("velocity", "NaN"),
    ],
)
def test_impossible_initial_states(
    tag: str, value: str, tmp_path: Path, source: str, capsys: pytest.CaptureFixture[str]
) -> None:
    refused(capsys, "decide", write(tmp_path, in_problem(source, tag, value)))


def test_dt_zero(tmp_path: Path, source: str, capsys: pytest.CaptureFixture[str]) -> None:
    text, count = re.subn(r'timeStepSize="[^"]*"', 'timeStepSize="0"', source)
    assert count == 1
    refused(capsys, "decide", write(tmp_path, text))


def test_no_lanelets(tmp_path: Path, source: str, capsys: pytest.CaptureFixture[str]) -> None:
    text = re.sub(r"<lanelet id.*?</lanelet>", "", source, flags=re.DOTALL)
    assert text != source
    refused(capsys, "decide", write(tmp_path, text))


def test_200_megabytes_of_noise_are_refused_at_once(tmp_path: Path) -> None:
    path = tmp_path / "noise.xml"
    with path.open("wb") as file:
        file.write(os.urandom(1 << 16))
        file.truncate(200 << 20)
    result = run("decide", str(path))
    assert result.returncode == 2
    assert len(result.stderr.strip().splitlines()) == 1


@pytest.mark.parametrize(
    ("words", "hint"),
    [
        (["verify", SCENARIO, "--pair", "fly,follow-lane"], "accelerate"),
        (["verify", SCENARIO, "--pair", "keep"], "accelerate"),
        (["verify", SCENARIO], "--all"),
        (["verify", SCENARIO, "--all", "--horizon", "0"], "horizon"),
        (["verify", SCENARIO, "--all", "--horizon", "-3"], "horizon"),
        (["verify", SCENARIO, "--all", "--horizon", "many"], "horizon"),
        (["verify", SCENARIO, "--all", "--rules", "R_G9"], "R_G1"),
        (["verify", SCENARIO, "--all", "--rules", "G(("], "column"),
        (["verify", SCENARIO, "--all", "--rules", "G(in_lane(middle))"], "lane"),
        (["verify", SCENARIO, "--all", "--prediction", "oracle"], "set-based"),
        (["decide", SCENARIO, "--settings", "nowhere.toml"], "nowhere.toml"),
        (["decide", SCENARIO, "--vocabulary", "nowhere.toml"], "nowhere.toml"),
        (["decide", SCENARIO, "--accept", "anything"], "reachable"),
        (["decide", SCENARIO, "--walk", "anything"], "ranked"),
        (["decide", SCENARIO, "--mode", "anything"], "verify-first"),
        (["decide", SCENARIO, "--k", "0"], "k"),
        (["decide", SCENARIO, "--deadline", "-1"], "deadline"),
        (["decide", SCENARIO, "--deadline", "nan"], "deadline"),
        (["decide", SCENARIO, "--ranker", "oracle"], "rules"),
        (["decide", SCENARIO, "--ranker", "replay:nowhere.csv"], "nowhere.csv"),
        (["decide", SCENARIO, "--problem", "123456"], "123456"),
        (["decide", SCENARIO, "--figure", "picture.docx"], ".png"),
        (["decide", SCENARIO, "--past", "keep"], "keep"),
        (["fly"], "decide"),
    ],
)
def test_bad_words(words: list[str], hint: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert hint in refused(capsys, *words)


@pytest.mark.parametrize(
    "text", ["a_lim = [", "a_lim = 'big'", "unknown = 1", "a_lon_min = 7.0", "horizon = 0"]
)
def test_bad_settings_files(text: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    refused(capsys, "decide", SCENARIO, "--settings", write(tmp_path, text, "settings.toml"))


def test_missing_api_key(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.delenv("OPENAI_API_KEY", raising=False)
    monkeypatch.delenv("OPENAI_BASE_URL", raising=False)
    line = refused(capsys, "decide", SCENARIO, "--ranker", "openai:any-model")
    assert "OPENAI_API_KEY" in line


def test_a_horizon_beyond_the_recording_says_what_is_assumed(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert main(["verify", "roadworks", "--all", "--horizon", "75", "--json"]) == 0
    assumed = json.loads(capsys.readouterr().out)["assumed"]
    assert any("keep its velocity" in note or "keep their velocity" in note for note in assumed)


def cpu_seconds(*words: str) -> float:
    """Least CPU time of three fresh processes."""
    code = "import os, subprocess, sys; subprocess.run(sys.argv[1:], capture_output=True); "
    code += "t = os.times(); print(t.children_user + t.children_system)"
    times = []
    for _ in range(3):
        result = subprocess.run(
            [sys.executable, "-c", code, sys.executable, *words],
            capture_output=True,
            text=True,
            check=True,
        )
        times.append(float(result.stdout))
    return min(times)


def test_import_and_help_are_quick() -> None:
    # No timing of our work: that no heavy package is imported is what keeps them quick.
    heavy = "{'numpy', 'openai', 'pydantic', 'matplotlib', 'commonroad', 'shapely', 'scipy'}"
    code = f"import sys, sandra; import sandra.cli; assert not {heavy} & set(sys.modules)"
    assert run_python(code) == 0
    assert cpu_seconds("-c", "import sandra") < 0.5
    assert cpu_seconds("-m", "sandra.cli", "--help") < 0.7


def test_a_first_decision_is_quick() -> None:
    """Nothing is loaded that a decision does without; SciPy alone would cost half a second."""
    heavy = "{'openai', 'matplotlib', 'scipy', 'google.protobuf'}"
    code = (
        "import sys, sandra; scene = sandra.load(sandra.example('intersection')); "
        "assert sandra.decide(scene, ranker='rules').maneuver.kind == 'certified'; "
        f"assert not {heavy} & set(sys.modules)"
    )
    assert run_python(code) == 0
    # 1.2 s on a quiet machine; tests that run beside this one share the caches of its cores.
    assert cpu_seconds("-m", "sandra.cli", "decide", "intersection") < 1.9


def run_python(code: str) -> int:
    return subprocess.run([sys.executable, "-c", code], check=False).returncode


def test_output_into_a_closed_pipe_is_no_error() -> None:
    command = f"{sys.executable} -m sandra.cli scenarios | head -n 0"
    result = subprocess.run(command, shell=True, capture_output=True, text=True, check=False)
    assert "Traceback" not in result.stderr


@pytest.mark.parametrize(
    ("ranker", "failures"),
    [
        ("adversarial", {None}),
        ("always:keep,follow-lane", {None}),
        ("garbage", {"empty", "malformed", "truncated", "infeasible"}),
        ("late:0.1", {"timeout"}),
    ],
)
def test_decide_with_a_ranker_that_misbehaves(
    capsys: pytest.CaptureFixture[str], ranker: str, failures: set[str | None]
) -> None:
    assert main(["decide", SCENARIO, "--ranker", ranker, "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["ranker"] == ranker
    assert told["failure"] in failures
    if None in failures:
        assert told["ranking"]
    else:
        assert told["ranking"] == []
        assert told["executed"]["kind"] == "fail-safe"
