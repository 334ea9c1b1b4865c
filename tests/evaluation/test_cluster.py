"""A real Dask cluster: the results of one process, whoever dies; and what is said where it ends."""

from __future__ import annotations

import json
import os
import pickle
import shutil
import signal
import socket
import subprocess
import sys
import time
import zlib
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

import pytest

import dask_cluster
import sandra
from sandra.cli import main
from sandra.errors import SandraError, SettingsError
from sandra.evaluation.closed_loop.batch import drive_all
from sandra.evaluation.closed_loop.drive import Drive
from sandra.evaluation.closed_loop.folder import RunFolder
from sandra.evaluation.dataset.build import build
from sandra.evaluation.labelling import Choice, label_all
from sandra.evaluation.open_loop.evaluate import open_loop
from sandra.evaluation.open_loop.setups import Setup
from sandra.evaluation.rollouts.cases import file_of
from sandra.evaluation.workers import Cluster, as_done, in_order
from sandra.evaluation.workers.away import packed
from sandra.learn.windows import Windows
from sandra.settings import Settings

distributed = pytest.importorskip("distributed")

CHOICE = Choice(ego="all", horizon=20, stride=20)


def free_port() -> int:
    with socket.socket() as found:
        found.bind(("127.0.0.1", 0))
        return int(found.getsockname()[1])


@pytest.fixture(scope="module")
def scheduler(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    with dask_cluster.scheduler(tmp_path_factory.mktemp("scheduler"), free_port()) as address:
        yield address


@pytest.fixture(scope="module")
def cluster(scheduler: str, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Cluster]:
    """Two workers, in another folder."""
    with dask_cluster.workers(scheduler, tmp_path_factory.mktemp("workers")):
        yield Cluster(scheduler)


@pytest.fixture
def client(scheduler: str) -> Iterator[Any]:
    """A look into the cluster from aside."""
    with distributed.Client(scheduler, set_as_default=False) as client:
        yield client


@pytest.fixture
def files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> list[Path]:
    """Relative to the folder in which we are, and in which no worker is; two are no scenarios."""
    monkeypatch.chdir(tmp_path)
    folder = Path("scenarios")
    folder.mkdir()
    for name in ("merge", "roadworks", "urban-parked"):
        shutil.copy(sandra.example(name), folder)
    (folder / "A_bad.xml").write_text("<commonRoad>")
    return [*sorted(folder.glob("*.xml")), folder / "missing.xml"]


def test_a_cluster_without_workers_is_not_waited_for_without_end(
    scheduler: str, caplog: pytest.LogCaptureFixture
) -> None:
    dask_cluster.wait_until(lambda: answers(scheduler))
    with pytest.raises(SandraError, match=r"has had no worker for 1 s; start one: dask worker"):
        list(as_done(abs, [1], Cluster(scheduler, patience=1.0)))
    assert "has no worker; waiting" in caplog.text


def answers(scheduler: str) -> bool:
    host, port = scheduler.removeprefix("tcp://").split(":")
    with socket.socket() as probe:
        return probe.connect_ex((host, int(port))) == 0


def test_scenes_are_loaded_from_what_was_sent(cluster: Cluster, files: list[Path]) -> None:
    """As soundness does it: an item is a number, and the file follows from it."""
    work = partial(dask_cluster.scene_of, files=tuple(files[1:3]))
    there = list(in_order(work, range(4), cluster, lambda n: (file_of(files[1:3], n),)))
    assert there == [work(n) for n in range(4)]


def test_rows_are_those_of_one_process_though_no_file_is_there(
    cluster: Cluster, files: list[Path]
) -> None:
    here, there = label_all(files, CHOICE), label_all(files, CHOICE, workers=cluster)
    assert there == here
    assert [Path(row["file"]).name for row in there.errors] == ["A_bad.xml", "missing.xml"]


def test_a_data_set_is_the_same(cluster: Cluster, files: list[Path]) -> None:
    how = Windows(per_vehicle=1, vehicles=1, settings=Settings(horizon=5))
    files[1].with_suffix(".crashed.json").write_text("no JSON")  # It goes with its recording.
    for name, workers in (("here", 1), ("there", cluster)):
        build(Path("scenarios"), Path(f"{name}.jsonl"), how, workers=workers)
    assert Path("there.jsonl").read_bytes() == Path("here.jsonl").read_bytes()
    assert "crashed must be steps" in Path("there.jsonl").read_text()


def test_the_closed_loop_and_recordings_are_written_by_the_client(
    cluster: Cluster, tmp_path: Path
) -> None:
    pytest.importorskip("highway_env")
    record = ["dataset", "record", "--environments", "merge", "--duration", "0.4"]
    how = Drive(driver="idle", steps=2)
    for name, workers in (("here", 1), ("there", cluster)):
        folder = RunFolder(tmp_path / name / "run")
        folder.open(how)
        (metrics,) = drive_all(folder, how, [5], workers)
        assert metrics["seed"] == 5
        where = ["--scheduler", cluster.address] if workers is cluster else []
        data = ["--episodes", "1", "--out", str(tmp_path / name / "data"), *where]
        assert main([*record, *data]) == 0
    for kind in ("run/seed-5/*", "data/*/*.xml"):
        here, there = (
            {
                file.name: file.read_bytes()
                for file in (tmp_path / name).glob(kind)
                if file.is_file()
            }
            for name in ("here", "there")
        )
        assert here
        assert there == here


def test_a_worker_that_is_killed_during_a_run_loses_nothing(
    cluster: Cluster, client: Any, tmp_path: Path
) -> None:
    client.wait_for_workers(2, timeout=60)
    processes = client.run(os.getpid)
    found = {}
    for n, square in as_done(dask_cluster.slow_square, range(12), cluster):
        if not found:
            os.kill(next(iter(processes.values())), signal.SIGKILL)
        found[n] = square
    assert found == {n: n * n for n in range(12)}


def test_a_scenario_that_kills_workers_is_an_error_row_and_the_run_goes_on(
    cluster: Cluster, files: list[Path], tmp_path: Path
) -> None:
    choice = Choice(ego="auto", horizon=10, windows=1)
    deadly = (Setup("dask_cluster:Deadly", horizon=5),)
    journal = tmp_path / "journal.jsonl"
    paths = files[1:4]
    found = open_loop(paths, deadly, choice, journal=journal, workers=cluster)
    (rows,) = found.rows.values()
    assert [row["file"] for row in rows] == [str(path) for path in paths]
    (broken,) = found.errors
    assert "Merge" in broken["file"]
    assert "3 processes that had it died; the last: the worker tcp://" in broken["error"]
    # The run is complete: going on with it asks nobody, here where the ranker would kill us.
    assert open_loop(paths, deadly, choice, journal=journal).rows == found.rows


def test_an_interrupted_run_cancels_its_tasks_and_goes_on(
    cluster: Cluster, client: Any, tmp_path: Path
) -> None:
    many = tmp_path / "many"
    many.mkdir()
    for n in range(6):
        shutil.copy(sandra.example("urban-parked"), many / f"{n:02d}.xml")
    words = ["label", str(many), "--ego", "all", "--horizon", "20", "--stride", "20"]
    words += ["--scheduler", cluster.address, "--out", str(tmp_path / "out")]
    code = (
        "import signal, sys; from sandra.cli import main; "
        "signal.signal(signal.SIGINT, signal.default_int_handler); sys.exit(main(sys.argv[1:]))"
    )
    process = subprocess.Popen(
        [sys.executable, "-c", code, *words], stderr=subprocess.PIPE, text=True
    )
    journal = tmp_path / "out" / "journal.jsonl"
    dask_cluster.wait_until(lambda: journal.exists() and journal.read_bytes().count(b"\n") > 1)
    process.send_signal(signal.SIGINT)
    _, told = process.communicate(timeout=30)
    assert process.returncode == 130
    assert told.strip().splitlines()[-1] == "interrupted"
    dask_cluster.wait_until(lambda: not any(client.processing().values()), 10.0)
    assert client.run_on_scheduler(lambda dask_scheduler: len(dask_scheduler.tasks)) == 0

    known = journal.read_bytes()
    assert 1 < known.count(b"\n") < 6
    assert main(words) == 0
    assert journal.read_bytes().startswith(known)
    rows = [json.loads(x) for x in (tmp_path / "out" / "labels.jsonl").read_text().splitlines()]
    alike = {json.dumps(row | {"file": None}) for row in rows}
    assert len(alike) * 6 == len(rows)


def test_a_worker_with_another_sandra_is_refused(
    scheduler: str,
    client: Any,
    files: list[Path],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    other = tmp_path / "other"
    shutil.copytree(dask_cluster.SOURCES / "sandra", other / "sandra")
    with (other / "sandra" / "errors.py").open("a") as file:
        file.write("# later\n")
    count = len(client.nthreads())
    with dask_cluster.workers(scheduler, tmp_path, 1, other):
        dask_cluster.wait_until(lambda: len(client.nthreads()) > count)
        assert main(["label", str(files[1]), "--scheduler", scheduler]) == 2
    told = capsys.readouterr().err.strip().splitlines()[-1]
    assert "has its sources" in told
    assert "install the same SanDRA there" in told


def test_nobody_answers(files: list[Path], capsys: pytest.CaptureFixture[str]) -> None:
    begin = time.monotonic()
    address = f"tcp://127.0.0.1:{free_port()}"
    assert main(["label", str(files[1]), "--scheduler", address]) == 2
    assert time.monotonic() - begin < 10.0
    told = capsys.readouterr().err.strip().splitlines()[-1]
    assert f"{address}: no Dask scheduler answers there" in told
    assert "start one with 'dask scheduler'" in told


@pytest.mark.parametrize(
    "address", ["localhost", "http://h:8786", "tcp://me:secret@h:1", "tcp://h"]
)
def test_no_address(address: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SettingsError, match="write tcp://HOST:PORT"):
        Cluster(address)


def test_answers_are_not_kept_all_over_the_cluster(capsys: pytest.CaptureFixture[str]) -> None:
    words = ["drive", "highway", "--cache", "answers", "--scheduler", "tcp://h:1"]
    assert main(words) == 2
    assert "--cache with --scheduler" in capsys.readouterr().err


def test_no_key_is_in_a_task(monkeypatch: pytest.MonkeyPatch, files: list[Path]) -> None:
    monkeypatch.setenv("OPENAI_API_KEY", "sk-very-secret")
    setup = Setup("openai:gpt-4o")
    parcel = zlib.decompress(packed(len, (files[1], (setup,)), [files[1]]))
    assert b"openai:gpt-4o" in parcel
    assert files[1].read_bytes() in parcel
    assert b"sk-very-secret" not in parcel
    assert pickle.loads(parcel)[1] == (files[1], (setup,))


def test_nothing_to_do_asks_nobody() -> None:
    assert list(in_order(abs, [], Cluster("tcp://127.0.0.1:1"))) == []
