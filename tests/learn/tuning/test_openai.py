"""`sandra finetune openai` with OpenAI's own library, against its interface on loopback."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from sandra.cli import main
from sandra.errors import SandraError
from sandra.learn.rows import Row
from sandra.learn.tuning import provider
from sandra.learn.tuning.hosted import Hosted
from sandra.learn.tuning.order import Estimate, Order, usual_passes
from sandra.learn.tuning.provider import Provider
from sandra.rankers import create
from tuning_rows import row
from tuning_server import KEY, MODEL, Fault, TuningServer, refusal, tuning_server

CREATE, LOOK, UPLOAD = "POST /fine_tuning/jobs", "GET /fine_tuning/jobs/ID", "POST /files"
LEARNING = ("validating_files", "queued", "running", "running", "succeeded")


@pytest.fixture(autouse=True)
def _key(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("OPENAI_API_KEY", KEY)
    monkeypatch.delenv("OPENAI_BASE_URL", raising=False)


@pytest.fixture
def server() -> Iterator[TuningServer]:
    with tuning_server() as found:
        yield found


@pytest.fixture
def data(tmp_path: Path) -> Path:
    rows = [row(i, "train") for i in range(12)] + [row(i, "validation") for i in range(20, 23)]
    rows += [row(30, "test"), Row("unknown", "train", "31.xml", 1, 1, detail="no label")]
    path = tmp_path / "data.jsonl"
    path.write_text("".join(each.line() for each in rows))
    return path


@pytest.fixture
def tune(server: TuningServer, data: Path, tmp_path: Path) -> Any:
    """Runs the command with what is always the same; more words follow."""

    def run(*words: str, rows: Path | None = data) -> int:
        first = [] if rows is None else [str(rows), "--model", MODEL, "--yes"]
        always = ["--base-url", server.url, "--out", str(tmp_path / "run"), "--every", "0.001"]
        return main(["finetune", "openai", *first, *always, *words])

    return run


def test_from_rows_to_a_ranker(
    server: TuningServer, tune: Any, data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    server.plan = LEARNING
    words = ["--epochs", "2", "--batch", "4", "--learning-rate", "0.5", "--suffix", "car-"]
    assert tune(*words, "--seed", "7", "--json") == 0
    told = json.loads(capsys.readouterr().out)
    assert told["status"] == "succeeded"
    assert told["trained_tokens"] == 4321
    assert told["ranker"] == f"openai:ft:{MODEL}:org::car-7p4"
    assert create(told["ranker"], base_url=server.url).name == told["ranker"]

    job = server.jobs[told["id"]]
    assert job["method"] == {
        "type": "supervised",
        "supervised": {
            "hyperparameters": {"n_epochs": 2, "batch_size": 4, "learning_rate_multiplier": 0.5}
        },
    }
    assert (job["seed"], job["suffix"]) == (7, "car-")
    sent = {name: server.files[job[f"{name}_file"]] for name in ("training", "validation")}
    lines = {name: [json.loads(x) for x in body.splitlines()] for name, body in sent.items()}
    assert {name: len(found) for name, found in lines.items()} == {"training": 12, "validation": 3}
    first = lines["training"][0]["messages"]
    assert [m["role"] for m in first] == ["system", "user", "assistant"]
    assert json.loads(first[2]["content"])["ranking"][0]["longitudinal"] == "decelerate"

    with (tmp_path / "run" / "loss.csv").open() as file:
        curve = list(csv.DictReader(file))
    found = {(p["split"], int(p["step"])): float(p["loss"]) for p in curve}
    assert found == {
        ("training", 1): 1.0,
        ("training", 2): 0.5,
        ("validation", 1): 1.1,
        ("validation", 2): 0.55,
    }
    assert (tmp_path / "run" / "loss.png").stat().st_size > 1000
    assert [path.name for path in (tmp_path / "run").glob(".*")] == []


def test_what_it_tells_a_person(
    server: TuningServer, tune: Any, capsys: pytest.CaptureFixture[str]
) -> None:
    server.plan = LEARNING
    assert tune() == 0
    output = capsys.readouterr()
    assert f"--ranker 'openai:ft:{MODEL}:org::7p4'" in output.out
    assert "12 examples for training, 3 for validation" in output.err
    assert "Step 2/3: training loss=0.50" in output.err
    assert output.err.index("Step 1/3") < output.err.index("Step 2/3")  # the oldest first


def test_nothing_is_sent_before_it_is_agreed_to(
    server: TuningServer, data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    prices = tmp_path / "prices.toml"
    prices.write_text(f'["openai:{MODEL}"]\ninput = 1\noutput = 2\ntraining = 5.0\n')
    words = ["finetune", "openai", str(data), "--model", MODEL, "--epochs", "4", "--base-url"]
    out = tmp_path / "run"
    assert main([*words, server.url, "--out", str(out), "--prices", str(prices)]) == 2
    told = capsys.readouterr().err
    assert "add --yes" in told
    assert "4 passes" in told
    assert "about 0.0" in told
    assert "USD" in told
    assert server.seen == []


@pytest.mark.parametrize(("said", "status"), [("n\n", 2), ("\n", 2), ("", 2), ("y\n", 0)])
def test_at_a_terminal_it_asks(
    said: str, status: int, server: TuningServer, data: Path, tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    terminal = io.StringIO(said)
    monkeypatch.setattr(terminal, "isatty", lambda: True)
    monkeypatch.setattr("sys.stdin", terminal)
    words = ["finetune", "openai", str(data), "--model", MODEL, "--base-url", server.url]
    assert main([*words, "--out", str(tmp_path / "run"), "--every", "0.001"]) == status
    assert "Upload the rows and start the job?" in capsys.readouterr().err
    assert len(server.jobs) == (status == 0)
    assert bool(server.seen) == (status == 0)


def test_an_estimate_multiplies_tokens_passes_and_the_price(data: Path, tmp_path: Path) -> None:
    from sandra.learn.rows import read_rows
    from sandra.rankers.usage import Price

    price = Price(1.0, 2.0, training=25.0)
    order = Order(MODEL, epochs=4)
    estimate: Estimate = Hosted(tmp_path / "run").prepare(read_rows(data), order, "", price)
    assert estimate.tokens == 4 * estimate.train.tokens > 0
    assert estimate.money == pytest.approx(estimate.tokens * 25e-6)
    assert [usual_passes(n) for n in (10, 33, 34, 8333, 10_000, 60_000)] == [10, 3, 3, 3, 2, 1]


def test_it_goes_on_watching(
    server: TuningServer, tune: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    """After an interruption: nothing is uploaded or started twice, no event told twice."""

    def interrupted(seconds: float) -> None:
        raise KeyboardInterrupt

    server.plan = ("queued", *["running"] * 9, "succeeded")
    with monkeypatch.context() as patch:
        patch.setattr("sandra.learn.tuning.hosted.time.sleep", interrupted)
        for _ in range(3):
            assert tune() == 130
    told = capsys.readouterr().err
    assert "ftjob-0 goes on without us: 'sandra finetune openai --out" in told
    assert "add --yes" not in told
    assert tune(rows=None) == 0
    told += capsys.readouterr().err
    for step in range(1, 10):
        assert told.count(f"Step {step}/3:") == 1
    assert (len(server.files), len(server.jobs)) == (2, 1)
    events = [e.id for e in Hosted(tmp_path / "run").events()]
    assert events == [e["id"] for e in server.events["ftjob-0"]]
    assert tune(rows=None) == 0  # it is over: the result, again


@pytest.mark.parametrize("change", ["model", "data", "epochs", "server"])
def test_a_folder_with_another_order_is_refused(
    change: str, tune: Any, data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert tune() == 0
    capsys.readouterr()
    kept = (tmp_path / "run" / "train.jsonl").read_bytes()
    if change == "data":
        data.write_text(data.read_text() + row(99, "train").line())
    words = {
        "model": ["--model", "another"],
        "epochs": ["--epochs", "5"],
        "server": ["--base-url", "http://127.0.0.1:9/v1"],
    }
    assert tune(*words.get(change, [])) == 2
    assert "choose another --out" in capsys.readouterr().err
    assert (tmp_path / "run" / "train.jsonl").read_bytes() == kept


def test_a_job_whose_start_was_not_answered_is_found_again(
    server: TuningServer, tune: Any, capsys: pytest.CaptureFixture[str]
) -> None:
    """The server starts it and hangs up; it must not be started, and paid, twice."""
    server.after[CREATE] = [None]
    assert tune() == 2
    assert "cannot be reached" in capsys.readouterr().err
    assert len(server.jobs) == 1
    assert tune() == 0
    assert len(server.jobs) == 1
    assert server.seen.count(UPLOAD) == 2


def test_a_job_that_was_started_elsewhere(
    server: TuningServer, tune: Any, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "t.jsonl"
    file.write_text(json.dumps({"messages": [{"role": "assistant", "content": "x"}]}) + "\n")
    file.write_text(file.read_text() * 10)
    other = Provider(server.url)
    job = other.create(Order(MODEL).request(other.upload(file), None))
    assert tune("--job", job.id, "--json", rows=None) == 0
    assert json.loads(capsys.readouterr().out)["ranker"] == f"openai:ft:{MODEL}:org::7p4"
    assert tune("--job", "ftjob-another", rows=None) == 2
    assert f"holds the job {job.id}" in capsys.readouterr().err


def test_cancel(
    server: TuningServer, tune: Any, monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    assert tune("--cancel", rows=None) == 2
    assert "there is no job in this folder" in capsys.readouterr().err

    def interrupted(seconds: float) -> None:
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr("sandra.learn.tuning.hosted.time.sleep", interrupted)
        assert tune() == 130
    capsys.readouterr()
    assert tune("--cancel", rows=None) == 1
    assert capsys.readouterr().out == "ftjob-0: cancelled\n"
    assert server.jobs["ftjob-0"]["status"] == "cancelled"


@pytest.mark.parametrize(
    ("status", "words"),
    [
        ("failed", "ftjob-0: failed: exceeded_quota: too much of it (training_file)\n"),
        ("cancelled", "ftjob-0: cancelled\n"),
    ],
)
def test_a_job_that_comes_to_nothing(
    status: str, words: str, server: TuningServer, tune: Any, capsys: pytest.CaptureFixture[str]
) -> None:
    server.plan = ("queued", status)
    server.failure = {
        "code": "exceeded_quota", "message": "too\nmuch of it", "param": "training_file",
    }  # fmt: skip
    assert tune() == 1
    assert capsys.readouterr().out == words


QUOTA = refusal("You exceeded your current quota.", "insufficient_quota", "insufficient_quota")
SLOWER = refusal("Rate limit reached.", "rate_limit_exceeded", "requests")


@pytest.mark.parametrize(
    ("what", "faults", "words"),
    [
        (UPLOAD, [(400, refusal("Invalid file format."))], "upload train.jsonl: HTTP 400"),
        (UPLOAD, [(401, refusal(f"Incorrect API key: {KEY}"))], "OPENAI_API_KEY to a key of this"),
        (CREATE, [(403, refusal("no"))], "this key may not fine-tune"),
        (CREATE, [(404, refusal("The model `x` does not exist"))], "check --model"),
        (CREATE, [(429, QUOTA)], "raise the limit of your account"),
        (LOOK, [(429, SLOWER)] * 99, "read the job ftjob-0: HTTP 429"),
        (LOOK, [(500, refusal("oh"))] * 99, "give the same command again"),
        (LOOK, [None] * 99, "check the network"),
        (LOOK, [(200, b"no JSON")], "does not answer as OpenAI's interface does"),
        (LOOK, [(200, b"[]")], "does not answer as OpenAI's interface does"),
        (LOOK, [(200, {"object": "fine_tuning.job", "status": "queued"})], "field 'id'"),
        ("GET /fine_tuning/jobs/ID/events", [(200, {"data": 3})], "does not answer as"),
        (UPLOAD, [(200, {"object": "file"})], "field 'id'"),
    ],
)  # fmt: skip
def test_what_goes_wrong_is_told_in_one_line(
    what: str, faults: list[Fault], words: str, server: TuningServer, tune: Any,
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    monkeypatch.setattr(provider, "LONGEST_PAUSE", 0.002)
    server.faults[what] = list(faults)
    assert tune() == 2
    told = capsys.readouterr()
    assert words in told.err.splitlines()[-1]
    assert told.err.splitlines()[-1].startswith("sandra finetune: ")
    assert KEY not in told.err + told.out
    assert told.out == ""
    server.faults.clear()
    assert tune() == 0  # what was done is not done again
    assert len(server.jobs) == 1


@pytest.mark.parametrize("what", [UPLOAD, CREATE, LOOK, "GET /fine_tuning/jobs/ID/events"])
def test_what_may_pass_is_asked_for_again(what: str, server: TuningServer, tune: Any) -> None:
    server.faults[what] = [(429, SLOWER), (429, SLOWER)]
    if what != CREATE:
        server.faults[what] += [(503, refusal("overloaded")), None]
    assert tune() == 0
    assert len(server.jobs) == 1


def test_a_wrong_key(
    server: TuningServer, tune: Any, monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    monkeypatch.setenv("OPENAI_API_KEY", "sk-wrong-wrong-wrong")
    assert tune() == 2
    told = capsys.readouterr().err
    assert "Incorrect API key provided: Bearer [key]" in told
    assert "sk-wrong" not in told
    assert server.seen == [UPLOAD]


def test_no_key_is_in_the_folder(tune: Any, tmp_path: Path) -> None:
    assert tune() == 0
    assert all(KEY.encode() not in file.read_bytes() for file in (tmp_path / "run").iterdir())


@pytest.mark.parametrize(
    ("words", "told"),
    [
        ([], "there is no job in this folder"),
        (["DATA"], "--model is missing"),
        (["FEW", "--model", "m"], "takes at least 10"),
        (["DATA", "--model", "m", "--epochs", "0"], "--epochs 0: must be greater"),
        (["DATA", "--model", "m", "--suffix", "x" * 65], "--suffix: at most 64"),
        (["DATA", "--model", "m", "--every", "nan"], "--every nan"),
        (["DATA", "--model", "m", "--base-url", "ftp://x"], "is no address"),
    ],
)
def test_bad_input(
    words: list[str], told: str, data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    few = tmp_path / "few.jsonl"
    few.write_text("".join(row(i, "train").line() for i in range(9)))
    files = {"DATA": str(data), "FEW": str(few)}
    given = [files.get(word, word) for word in words]
    address = [] if "--base-url" in given else ["--base-url", "http://127.0.0.1:9/v1"]
    out = ["--out", str(tmp_path / "run"), "--yes"]
    assert main(["finetune", "openai", *given, *address, *out]) == 2
    lines = capsys.readouterr().err.strip().splitlines()
    assert len(lines) == 1
    assert told in lines[0]


def test_a_folder_of_something_else(tmp_path: Path) -> None:
    (tmp_path / "job.json").write_text("{}")
    with pytest.raises(SandraError, match="no job of ours"):
        Hosted(tmp_path)
