"""Items walk to whoever is free, and answers come back; who that is, a `Team` knows.

An item whose worker died is given to another one, since the item need not be to blame. If it is,
it ends as an error after `TRIES` deaths, and everything else goes on.
"""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Callable, Generator, Iterable, Sequence
from contextlib import closing
from itertools import chain
from pathlib import Path
from typing import Any, Protocol, TypeVar

from sandra.evaluation.workers.cluster import Cluster, ClusterTeam
from sandra.evaluation.workers.items import Broken, Died, Refused, attempt
from sandra.evaluation.workers.local import LocalTeam, processes

T = TypeVar("T")
R = TypeVar("R")
T_contra = TypeVar("T_contra", contravariant=True)

Workers = int | Cluster
"""A number of processes on this machine, `ALL_CORES`, or a cluster."""
AHEAD = 4
"""In order: so many items per worker are begun before the first of them is answered."""
TRIES = 3
"""So many workers may die with the same item."""


class Team(Protocol[T_contra]):
    """Workers with one item each at a time, so that a death is the death of one item's worker."""

    def size(self) -> int:
        """How many there are now."""

    def free(self) -> bool:
        """Whether somebody can be given an item."""

    def give(self, number: int, item: T_contra) -> None:
        """Hand an item over, if somebody is free."""

    def collect(self) -> Sequence[tuple[int, Any]]:
        """Wait for a while: numbers of items with their answers, or with `Broken`, `Died`."""

    def stop(self) -> None:
        """End all work that is still going on."""


def _no_files(item: Any) -> Iterable[Path]:
    return ()


def as_done(
    work: Callable[[T], R],
    items: Iterable[T],
    workers: Workers = 1,
    files: Callable[[T], Iterable[Path]] = _no_files,
) -> Generator[tuple[T, R | Broken], None, None]:
    """Each item with `work(item)`, as they come.

    Args:
        work: a function of a module, whose arguments and results can be pickled.
        workers: 1 works in this process.
        files: those that `work` reads for an item; their content goes with it to a cluster, where
            `sandra.scene.sent` finds it under the same paths.

    Raises:
        SandraError: raised by `work`; or no process can be started, or the cluster cannot be used.
    """
    with closing(_answers(work, items, workers, files, None)) as found:
        for _, item, answer in found:
            yield item, _opened(answer)


def in_order(
    work: Callable[[T], R],
    items: Iterable[T],
    workers: Workers = 1,
    files: Callable[[T], Iterable[Path]] = _no_files,
) -> Generator[R | Broken, None, None]:
    """`work(item)` for each item, in the order of the items, which may be without end.

    Arguments and errors are those of `as_done`.
    """
    known: dict[int, R | Broken | Refused] = {}
    next_one = 0
    with closing(_answers(work, items, workers, files, AHEAD)) as found:
        for number, _, answer in found:
            known[number] = answer
            while next_one in known:
                yield _opened(known.pop(next_one))
                next_one += 1


def _answers(
    work: Callable[[T], R],
    items: Iterable[T],
    workers: Workers,
    files: Callable[[T], Iterable[Path]],
    ahead: int | None,
) -> Generator[tuple[int, T, R | Broken | Refused], None, None]:
    rest = iter(items)
    for first in rest:
        items = chain([first], rest)
        break
    else:
        return  # Nothing to do, and nobody to be asked for it.
    if isinstance(workers, Cluster):
        team: Team[T] = ClusterTeam(workers, work, files)
    elif processes(workers) == 1:
        for number, item in enumerate(items):
            yield number, item, attempt(work, item)
        return
    else:
        team = LocalTeam(work, processes(workers))
    try:
        yield from _walk(team, items, ahead)
    finally:
        team.stop()


def _walk(
    team: Team[T], items: Iterable[T], ahead: int | None
) -> Generator[tuple[int, T, Any], None, None]:
    """Numbers, items and answers; with `ahead`, nobody runs further ahead of the slowest item."""
    rest = iter(enumerate(items))
    begun: dict[int, T] = {}  # In the order of the items: the first is the slowest.
    again: deque[int] = deque()
    deaths: Counter[int] = Counter()
    given, more = 0, True
    while True:
        while team.free():
            if again:
                number = again.popleft()
                team.give(number, begun[number])
                continue
            slowest = next(iter(begun), given)
            if not more or (ahead is not None and given - slowest >= ahead * team.size()):
                break
            for number, item in rest:
                begun[number] = item
                team.give(number, item)
                given = number + 1
                break
            else:
                more = False
        if not begun and not more:
            return
        for number, answer in team.collect():
            if isinstance(answer, Died):
                deaths[number] += 1
                if deaths[number] < TRIES:
                    again.append(number)
                    continue
                answer = Broken(f"{TRIES} processes that had it died; the last: {answer.how}")
            yield number, begun.pop(number), answer


def _opened(answer: R | Broken | Refused) -> R | Broken:
    if isinstance(answer, Refused):
        raise answer.error
    return answer
