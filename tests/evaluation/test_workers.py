"""Many items in several processes: the same answers, and nobody takes others down."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from contextlib import closing
from functools import partial
from itertools import count, islice
from pathlib import Path

import pytest

from sandra.errors import ScenarioError, SettingsError
from sandra.evaluation.workers import Broken, as_done, in_order, processes


def slow_square(n: int) -> int:
    """Those that come first take longest."""
    time.sleep(0.3 if n % 4 == 0 else 0.0)
    return n * n


def moody(n: int) -> int:
    if n == 1:
        raise ZeroDivisionError("not\ntoday")
    if n == 3:
        raise KeyError
    return n


def deadly(n: int) -> int:
    if n == 2:
        os.kill(os.getpid(), signal.SIGKILL)
    if n == 4:
        os._exit(7)
    return n


def mortal(n: int, folder: Path) -> int:
    """Item 3 is killed once, as by somebody else."""
    if n == 3 and not (folder / "killed").exists():
        (folder / "killed").touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return n * n


def refusing(n: int) -> int:
    if n == 2:
        raise ScenarioError("2: no scenario; give another")
    return n


def unsendable(n: int) -> object:
    return (lambda: n) if n == 1 else n


def pid(n: int) -> int:
    time.sleep(0.05)
    return os.getpid()


@pytest.mark.parametrize("workers", [1, 2, 3])
def test_answers_come_in_the_order_of_the_items(workers: int) -> None:
    assert list(in_order(slow_square, range(9), workers)) == [n * n for n in range(9)]
    assert list(in_order(slow_square, [], workers)) == []
    assert list(in_order(slow_square, [5], workers)) == [25]


@pytest.mark.parametrize("workers", [1, 2])
def test_there_may_be_items_without_end(workers: int) -> None:
    with closing(in_order(slow_square, count(), workers)) as answers:
        assert list(islice(answers, 6)) == [n * n for n in range(6)]


@pytest.mark.parametrize("workers", [1, 2])
def test_an_exception_is_the_answer_to_its_item(
    workers: int, caplog: pytest.LogCaptureFixture
) -> None:
    found = list(in_order(moody, range(6), workers))
    broken = [Broken("ZeroDivisionError: not today"), Broken("KeyError")]
    assert found == [0, broken[0], 2, broken[1], 4, 5]
    if workers == 1:
        assert "ZeroDivisionError" in caplog.text


def test_an_item_that_kills_processes_is_an_error_after_three() -> None:
    found = list(in_order(deadly, range(7), 2))
    assert [x for x in found if isinstance(x, int)] == [0, 1, 3, 5, 6]
    assert found[2] == Broken("3 processes that had it died; the last: signal SIGKILL")
    assert found[4] == Broken("3 processes that had it died; the last: exit status 7")


def test_a_process_that_is_killed_loses_nothing(tmp_path: Path) -> None:
    once = partial(mortal, folder=tmp_path)
    assert list(in_order(once, range(5), 2)) == [0, 1, 4, 9, 16]
    assert (tmp_path / "killed").exists()


@pytest.mark.parametrize("workers", [1, 2])
def test_as_they_come(workers: int) -> None:
    found = list(as_done(slow_square, [0, 1, 2, 3], workers))
    assert sorted(found) == [(n, n * n) for n in range(4)]
    assert [n for n, _ in found] == ([0, 1, 2, 3] if workers == 1 else [1, 2, 3, 0])


@pytest.mark.parametrize("workers", [1, 2])
def test_what_the_user_can_mend_is_raised(workers: int) -> None:
    answers = in_order(refusing, range(6), workers)
    assert [next(answers), next(answers)] == [0, 1]
    with pytest.raises(ScenarioError, match="give another"):
        next(answers)


def test_an_answer_that_cannot_be_sent() -> None:
    found = list(in_order(unsendable, range(3), 2))
    assert [found[0], found[2]] == [0, 2]
    assert isinstance(found[1], Broken)
    assert "cannot be sent" in found[1].error


def test_processes() -> None:
    assert set(in_order(pid, range(4), 1)) == {os.getpid()}
    found = set(in_order(pid, range(8), 2))
    assert len(found) <= 2
    assert os.getpid() not in found
    assert processes(3) == 3
    assert processes(0) == len(os.sched_getaffinity(0))
    with pytest.raises(SettingsError, match="all cores"):
        processes(-1)


def alive(process: int) -> bool:
    return Path(f"/proc/{process}").exists()


def test_nobody_is_left_behind() -> None:
    with closing(in_order(pid, count(), 2)) as answers:
        found = set(islice(answers, 6))
    assert found
    assert not any(alive(process) for process in found)


def test_a_script_without_a_main_guard_is_told_so(tmp_path: Path) -> None:
    script = tmp_path / "script.py"
    script.write_text(
        "from math import sqrt\nfrom sandra.evaluation.workers import in_order\n"
        "print(list(in_order(sqrt, [1.0, 4.0], 2)))\n"
    )
    result = subprocess.run(
        [sys.executable, str(script)], capture_output=True, text=True, timeout=60, check=False
    )
    assert result.returncode == 1
    assert "if __name__ == '__main__'" in result.stderr.strip().splitlines()[-1]


BLOCKED = """
import signal
from sandra.evaluation.workers import in_order

def blocked(n):
    return signal.SIGINT in signal.pthread_sigmask(signal.SIG_BLOCK, ())

if __name__ == "__main__":
    print(list(in_order(blocked, range(4), 2)), blocked(0))
"""


def test_the_keyboard_interrupts_no_worker_from_its_first_moment_on(tmp_path: Path) -> None:
    script = tmp_path / "script.py"
    script.write_text(BLOCKED)
    result = subprocess.run(
        [sys.executable, str(script)], capture_output=True, text=True, timeout=60, check=True
    )
    assert result.stdout.strip() == "[True, True, True, True] False"


INTERRUPTIBLE = """
import signal, sys
from sandra.cli import main
signal.signal(signal.SIGINT, signal.default_int_handler)  # ignored where a shell started us with &
sys.exit(main(sys.argv[1:]))
"""


def test_control_c_ends_all_and_says_one_word(tmp_path: Path) -> None:
    """As a terminal does it: the signal goes to the whole process group."""
    settings = tmp_path / "settings.toml"
    settings.write_text("horizon = 6")
    words = ["evaluate", "soundness", "roadworks", "--rollouts", "1000000", "--workers", "2"]
    words += ["--per-certificate", "6", "--settings", str(settings)]
    process = subprocess.Popen(
        [sys.executable, "-c", INTERRUPTIBLE, *words],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    assert process.stderr is not None
    first = process.stderr.readline()  # Progress: the workers are at work.
    begin = time.monotonic()
    os.killpg(process.pid, signal.SIGINT)
    out, err = process.communicate(timeout=20)
    assert time.monotonic() - begin < 10.0
    assert process.returncode == 130
    assert "rollouts" in first
    assert "Traceback" not in err
    assert err.strip().splitlines()[-1] == "interrupted"
    assert out == ""
    assert nobody_of(process.pid)


def nobody_of(group: int) -> bool:
    """Whether all processes of a group end soon: the interpreter's own helpers take a moment."""
    end = time.monotonic() + 5.0
    while time.monotonic() < end:
        try:
            os.killpg(group, 0)
        except ProcessLookupError:
            return True
        time.sleep(0.05)
    return False
