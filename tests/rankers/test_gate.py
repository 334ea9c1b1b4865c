"""How many requests are on their way at once, and none while the server wants none."""

import multiprocessing
import os
import threading
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from email.utils import formatdate
from pathlib import Path

import pytest

from chat_server import ChatServer, chat_server
from hostile_server import GOOD, Handler, Play, answer, error, stall, whole
from sandra.describe import describe
from sandra.errors import RankerError
from sandra.rankers import Failure, create
from sandra.rankers.bounded import Deadline
from sandra.rankers.client import _pause
from sandra.rankers.gate import MOST, Gate
from straight_road import Road

PROMPT = describe(Road().scene())
ALL = answer(*GOOD)


@pytest.fixture(autouse=True)
def _surroundings(no_openai_key: None, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))


def slow(seconds: float) -> Play:
    def play(handler: Handler) -> None:
        time.sleep(seconds)
        whole(ALL)(handler)

    return play


@pytest.fixture
def server() -> Iterator[ChatServer]:
    with chat_server(slow(0.1)) as server:
        yield server


def test_so_many_at_once_and_no_more(server: ChatServer) -> None:
    ranker = create("openai:m", base_url=server.url, max_concurrent=3)
    with ThreadPoolExecutor(12) as pool:
        rankings = list(pool.map(lambda _: ranker.rank(PROMPT, 20.0), range(12)))
    assert all(ranking.failure is None for ranking in rankings)
    assert server.most_at_once == 3


def test_all_rankers_of_a_process_share_the_places(server: ChatServer) -> None:
    with ThreadPoolExecutor(8) as pool:
        names = [f"openai:m{n}" for n in range(8)]
        list(
            pool.map(
                lambda name: create(name, base_url=server.url, max_concurrent=2).rank(PROMPT, 20.0),
                names,
            )
        )
    assert server.most_at_once == 2


def test_without_a_number_there_is_one_too(server: ChatServer) -> None:
    ranker = create("openai:m", base_url=server.url)
    with ThreadPoolExecutor(3 * MOST) as pool:
        list(pool.map(lambda _: ranker.rank(PROMPT, 20.0), range(3 * MOST)))
    assert server.most_at_once <= MOST


def in_a_process(url: str, temporary: str) -> None:
    os.environ["TMPDIR"] = temporary
    ranker = create("openai:m", base_url=url, max_concurrent=2)
    with ThreadPoolExecutor(4) as pool:
        assert all(r.pairs for r in pool.map(lambda _: ranker.rank(PROMPT, 60.0), range(4)))


@pytest.mark.skipif(os.name != "posix", reason="locks of files are those of POSIX")
def test_one_number_over_all_processes(server: ChatServer, tmp_path: Path) -> None:
    context = multiprocessing.get_context("spawn")
    workers = [
        context.Process(target=in_a_process, args=(server.url, str(tmp_path))) for _ in range(3)
    ]
    for worker in workers:
        worker.start()
    for worker in workers:
        worker.join()
        assert worker.exitcode == 0
    assert len(server.requests) == 12
    assert server.most_at_once == 2


def hold(temporary: str) -> None:
    os.environ["TMPDIR"] = temporary
    assert Gate("http://here/", 1).enter(Deadline(5.0)) is not None
    os._exit(0)  # without giving it back


@pytest.mark.skipif(os.name != "posix", reason="locks of files are those of POSIX")
def test_who_dies_gives_his_place_back(tmp_path: Path) -> None:
    worker = multiprocessing.get_context("spawn").Process(target=hold, args=(str(tmp_path),))
    worker.start()
    worker.join()
    release = Gate("http://here/", 1).enter(Deadline(5.0))
    assert release is not None
    assert Gate("http://here/", 1).enter(Deadline(0.1)) is None
    other = Gate("http://there/", 1).enter(Deadline(0.1))
    assert other is not None
    other()
    release()
    again = Gate("http://here/", 1).enter(Deadline(0.1))
    assert again is not None
    again()


def test_waiting_for_a_place_counts_as_waiting(server: ChatServer) -> None:
    server.plays = [stall]
    ranker = create("openai:m", base_url=server.url, max_concurrent=1)
    first = threading.Thread(target=ranker.rank, args=(PROMPT, 1.5))
    first.start()
    time.sleep(0.3)
    begin = time.monotonic()
    ranking = ranker.rank(PROMPT, 0.3)
    assert 0.3 <= time.monotonic() - begin < 1.0
    assert ranking.failure is Failure.TIMEOUT
    assert ranking.usage is not None
    assert ranking.usage.requests == 0
    first.join()
    assert len(server.requests) == 1


@pytest.mark.parametrize("number", [0, -1])
def test_a_number_that_is_none(number: int) -> None:
    with pytest.raises(RankerError, match="at least 1"):
        create("openai:m", base_url="http://localhost:1/v1", max_concurrent=number)


@pytest.mark.skipif(os.name != "posix", reason="locks of files are those of POSIX")
def test_a_place_for_locks_that_is_none(tmp_path: Path) -> None:
    (tmp_path / f"sandra-{os.getuid()}").write_text("", encoding="utf-8")
    with pytest.raises(RankerError, match="TMPDIR"):
        create("openai:m", base_url="http://localhost:1/v1", max_concurrent=1)
    (tmp_path / f"sandra-{os.getuid()}").unlink()
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    (tmp_path / f"sandra-{os.getuid()}").symlink_to(elsewhere)
    with pytest.raises(RankerError, match="somebody else"):
        create("openai:m", base_url="http://localhost:1/v1", max_concurrent=1)


def test_a_429_is_heeded_by_everybody(server: ChatServer) -> None:
    """One is told to wait; the others, with another model, wait too."""
    times: list[float] = []

    def play(handler: Handler) -> None:
        times.append(time.monotonic())
        (error(429, retry_after="1") if len(times) == 1 else whole(ALL))(handler)

    server.plays = [play]
    rankers = [create(f"openai:m{n}", base_url=server.url) for n in range(5)]
    first = threading.Thread(target=rankers[0].rank, args=(PROMPT, 20.0))
    first.start()
    while not times:
        time.sleep(0.01)
    time.sleep(0.2)
    with ThreadPoolExecutor(4) as pool:
        rankings = list(pool.map(lambda ranker: ranker.rank(PROMPT, 20.0), rankers[1:]))
    first.join()
    assert all(ranking.failure is None for ranking in rankings)
    assert len(times) == 6
    assert min(times[1:]) - times[0] > 0.9


def test_a_long_pause_is_a_failure_at_once_and_not_asked_again(server: ChatServer) -> None:
    server.plays = [error(429, retry_after="100")]
    ranker = create("openai:m", base_url=server.url)
    begin = time.monotonic()
    rankings = [ranker.rank(PROMPT, 20.0) for _ in range(3)]
    assert time.monotonic() - begin < 10.0
    assert {ranking.failure for ranking in rankings} == {Failure.RATE_LIMITED}
    assert len(server.requests) == 1
    assert "asked for a pause" in (rankings[-1].detail or "")
    assert rankings[-1].usage is not None
    assert rankings[-1].usage.requests == 0
    # It is that server's wish alone.
    with chat_server(whole(ALL)) as elsewhere:
        assert create("openai:m", base_url=elsewhere.url).rank(PROMPT, 20.0).failure is None


NOW = "Wed, 21 Oct 2026 07:28:00 GMT"


@pytest.mark.parametrize(
    ("text", "now", "seconds"),
    [
        ("3", None, 3.0),
        ("0.5", None, 0.5),
        ("1e9", None, 3600.0),
        ("inf", None, 3600.0),
        ("nan", None, None),
        ("-1", None, None),
        ("soon", None, None),
        ("", None, None),
        (None, None, None),
        ("Wed, 21 Oct 2026 07:28:30 GMT", NOW, 30.0),
        ("Wed, 21 Oct 2026 07:27:30 GMT", NOW, 0.0),
        ("Wed, 21 Oct 2026 07:28:30 -0000", NOW, 30.0),
        ("Fri, 23 Oct 2026 07:28:30 GMT", NOW, 3600.0),
        ("Wed, 99 Oct 2026 07:28:30 GMT", NOW, None),
        ("in two hours", None, 3600.0),
    ],
)
def test_how_long_a_server_wants_to_be_left_alone(
    text: str | None, now: str | None, seconds: float | None
) -> None:
    """Dates are held against the server's own clock, where it tells it."""
    if text == "in two hours":
        text = formatdate(time.time() + 7200.0, usegmt=True)
    assert _pause(text, now) == seconds
