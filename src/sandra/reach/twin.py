"""The native twin of the kernel, if it was built: the same sets in a fraction of the time.

`SANDRA_KERNEL=python` or `native` chooses one; without it the native one is used where it is there.
"""

from __future__ import annotations

import os
import warnings
from collections.abc import Callable, Sequence
from functools import partial
from hashlib import sha256
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from sandra.errors import SettingsError
from sandra.reach import kernel
from sandra.reach.answers import Fixed, SafeDistance, Touching
from sandra.reach.bands import Band
from sandra.reach.later import Later
from sandra.reach.lattice import Copied, Lattice, Mask, packed
from sandra.reach.moves import Move, Moves
from sandra.reach.problem import Answer, Problem, Region, in_groups
from sandra.reach.sets import BaseSet, ReachableSet

VARIABLE = "SANDRA_KERNEL"


def built(sources: Path) -> Any:
    """The native kernel; None if it was not built, or from other sources than those in a folder."""
    try:
        module = import_module("sandra.reach._native")
    except ImportError:  # no compiler when the package was installed
        return None
    files = sorted(sources.glob("*.?pp"))  # a package that is not worked on comes without them
    stamp = sha256(b"".join(path.read_bytes() for path in files)).hexdigest()
    if files and getattr(module, "SOURCES", "") != stamp:
        warnings.warn(
            "the native kernel was built from other sources than those that are here, so the "
            "Python kernel is used: build it anew with 'pip install -e .'",
            RuntimeWarning,
            stacklevel=2,
        )
        return None
    return module


native = built(Path(__file__).with_name("native"))


def reachable_set(problem: Problem) -> ReachableSet:
    """Compute the set from step 0 until it is empty or the horizon is reached.

    Raises:
        SettingsError: if `SANDRA_KERNEL` names an unknown kernel, or one that was not built.
    """
    return reachable_sets([problem])[0]


def reachable_sets(problems: Sequence[Problem]) -> list[ReachableSet]:
    """The set of each problem; what differs in the last letter alone shares all steps before.

    Raises:
        SettingsError: as `reachable_set`.
    """
    if chosen() == "python":
        return kernel.reachable_sets(problems)
    return in_groups(problems, _computed)


def chosen() -> str:
    """The kernel that is used: "native" or "python".

    Raises:
        SettingsError: as `reachable_set`.
    """
    name = os.environ.get(VARIABLE, "")
    if name not in ("", "python", "native"):
        raise SettingsError(f"{VARIABLE}={name}: choose python or native, or leave it unset")
    if name == "native" and native is None:
        raise SettingsError(
            f"{VARIABLE}=native: the native kernel was not built; install the package where there "
            f"is a C++ compiler, or set {VARIABLE}=python"
        )
    return name or ("python" if native is None else "native")


def _computed(problems: list[Problem]) -> list[ReachableSet]:
    """The sets of problems that are alike until the last letter is read."""
    problem = problems[0]
    found = native.reachable_sets(
        problem.dt,
        problem.horizon,
        problem.lon,
        problem.lat,
        problem.a_lat,
        problem.v_lon,
        problem.v_lat,
        problem.tight,
        _copied(problem.forbidden, partial(_field, problem.lattice)),
        [
            (_copied(each.moves, _moves), [_copied(answer, _answer) for answer in each.answers])
            for each in problems
        ],
    )
    sets = []
    for i in range(len(problems)):
        steps, contested = NativeSteps(found, i), found.contested(i)
        mask = None if contested is None else mask_of(problem.lattice, contested)
        sets.append(ReachableSet(steps, problem.horizon, problem.lattice, mask))
    return sets


class NativeSteps(Later[tuple[BaseSet, ...]]):
    """The base sets of each step, held by the native kernel until somebody looks at them.

    `found` are the sets of problems that share all but their last step; `which` is one of them.
    """

    def __init__(self, found: Any, which: int) -> None:
        super().__init__(self._made)
        self._found, self._which = found, which
        self.sizes: tuple[int, ...] = tuple(found.sizes(which))

    def _made(self) -> tuple[tuple[BaseSet, ...], ...]:
        return tuple(
            tuple(BaseSet(*each) for each in self._found.step(self._which, k))
            for k in range(len(self.sizes))
        )

    def __len__(self) -> int:
        return len(self.sizes)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Sequence) and tuple(self) == tuple(other)

    __hash__ = None  # type: ignore[assignment]  # like a list: looked at, not a key


def _copied(owner: Any, make: Callable[[Any], Any]) -> Any:
    """The native copy of something that never changes; kept with it if it has room for it."""
    if not isinstance(owner, Copied):
        return make(owner)
    # Two threads may both make one: they are alike.
    kept = owner.__dict__
    return kept["_native"] if "_native" in kept else kept.setdefault("_native", make(owner))


def numbers_of(lattice: Lattice) -> tuple[float, float, float, float, int, int]:
    """A lattice as the native kernel takes it."""
    return lattice.s0, lattice.d0, lattice.ds, lattice.dd, lattice.columns, lattice.rows


def _field(lattice: Lattice, forbidden: Sequence[Mask]) -> Any:
    return native.Field(numbers_of(lattice), packed(forbidden))


def mask_of(lattice: Lattice, words: bytes) -> Mask:
    """The cells whose bits are set in the native kernel's words."""
    bits = np.frombuffer(words, dtype=np.uint8).reshape(lattice.rows, -1)
    cells = np.unpackbits(bits, axis=1, count=lattice.columns, bitorder="little")
    return np.ascontiguousarray(cells.T).astype(np.bool_)


def _moves(moves: Moves) -> Any:
    def table(rows: tuple[tuple[Move, ...], ...]) -> list[Any]:
        return [[(m.target, list(m.literals), m.inputs) for m in row] for row in rows]

    live = [sorted(row) for row in moves.live]
    return native.Moves(moves.initial, table(moves.moves), table(moves.final), live)


def _answer(answer: Answer) -> Any:
    if isinstance(answer, Fixed):
        return native.Fixed(_region(answer.holds), _region(answer.fails))
    if isinstance(answer, Touching):
        body = answer.body
        return native.Touching(
            [_band(x) for x in answer.bands],
            (body.length, body.width, body.grip, body.heading),
            list(body.bend),
            numbers_of(body.lattice),
            _region(answer.fails),
        )
    if isinstance(answer, SafeDistance):
        tables = [
            [[(end, list(cuts)) for end, cuts in step] for step in table] for table in answer.tables
        ]
        return native.SafeDistance([_band(x) for x in answer.bands], tables, answer.inner)

    def asked(truth: bool, k: int, lon: Any, lat: Any) -> Any:
        return _region(answer(truth, k, lon, lat))

    return native.Custom(asked)


def _region(region: Region) -> list[Any]:
    return [[(piece.box, list(piece.cuts)) for piece in union] for union in region]


def _band(band: Band) -> list[tuple[float, ...]]:
    return [(x.s_low, x.s_high, x.right_low, x.right_high, x.left_low, x.left_high) for x in band]
