"""The native kernel gives the sets of the Python kernel, to the last bit."""

import pickle
from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from random_problems import other_ends, problem
from random_scenes import draw
from sandra.actions import ALL_PAIRS
from sandra.errors import SettingsError
from sandra.prediction import predict
from sandra.reach import ReachableSet, ground, kernel, reachable_set, twin, verify_on
from sandra.reach.moves import Move
from sandra.reach.problem import alike
from sandra.settings import PRECISIONS, Settings

needs_native = pytest.mark.skipif(twin.native is None, reason="the native kernel was not built")


@pytest.fixture
def native(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(twin.VARIABLE, "native")


def assert_same(found: ReachableSet, expected: ReachableSet) -> None:
    assert found.first_empty_step == expected.first_empty_step
    assert tuple(found.steps) == expected.steps
    assert found.steps == expected.steps
    assert found.steps != (*expected.steps, ())
    assert found.steps.sizes == tuple(len(step) for step in expected.steps)
    assert (found.contested is None) == (expected.contested is None)
    if found.contested is not None:
        assert found.contested.dtype == np.bool_
        assert (found.contested == expected.contested).all()


@needs_native
@pytest.mark.parametrize("block", range(10))
def test_random_problems(native: None, block: int) -> None:
    ends: Counter[int | None] = Counter()
    for seed in range(200 * block, 200 * (block + 1)):
        some = problem(seed)
        expected = kernel.reachable_set(some)
        assert_same(reachable_set(some), expected)
        ends[expected.first_empty_step] += 1
    # neither all empty nor all full
    assert ends[None] > 20
    assert ends[0] > 5
    assert sum(n for step, n in ends.items() if step) > 20


@needs_native
def test_problems_with_other_last_letters_share_their_steps(native: None) -> None:
    for seed in range(100):
        group = other_ends(problem(seed), seed)
        for found, each in zip(twin.reachable_sets(group), group, strict=True):
            expected = kernel.reachable_sets([each])[0]
            assert_same(found, expected)
        for found, expected in zip(
            twin.reachable_sets(group), kernel.reachable_sets(group), strict=True
        ):
            assert_same(found, expected)


def test_what_is_not_alike_is_not_shared() -> None:
    own = next(p for p in map(problem, range(50)) if p.answers and p.horizon > 1)
    low, high = own.v_lon
    changed = [
        replace(own, dt=own.dt * 2),
        replace(own, horizon=own.horizon - 1),
        replace(own, lon=[(x + 1.0, v) for x, v in own.lon]),
        replace(own, lat=[(x + 0.1, v) for x, v in own.lat]),
        replace(own, a_lat=(-1.5, 1.0)),
        replace(own, v_lon=(low, high + 1.0)),
        replace(own, v_lat=(-2.5, 2.0)),
        replace(own, tight=not own.tight),
        replace(own, lattice=replace(own.lattice, ds=2 * own.lattice.ds)),
        replace(own, forbidden=tuple(m.copy() for m in own.forbidden)),
        replace(own, moves=replace(own.moves, live=(*own.moves.live[::-1], frozenset({7})))),
        replace(own, moves=replace(own.moves, initial=own.moves.initial + 1)),
        replace(own, moves=replace(own.moves, moves=((Move(0, (), (-0.5, 0.25)),),))),
    ]
    assert alike([own, *changed]) == [[i] for i in range(len(changed) + 1)]
    with_literal = replace(own, moves=replace(own.moves, moves=((Move(0, ((0, True),), (0, 1)),),)))
    elsewhere = replace(with_literal, answers=tuple(lambda *_: () for _ in own.answers))
    ending = replace(with_literal, moves=replace(with_literal.moves, final=((),)))
    assert alike([with_literal, elsewhere, ending]) == [[0, 2], [1]]


def _scenes(seeds: range, monkeypatch: pytest.MonkeyPatch) -> int:
    count = 0
    for seed in seeds:
        settings = Settings(horizon=6 + seed % 10, precision=PRECISIONS[seed % 3 == 0])
        scene = draw(seed).scene
        kind = ("most-likely", "set-based")[seed % 2]
        base = ground(scene, predict(scene, kind, settings.horizon, settings), settings)
        for rules in ((), ("R_G1", "R_G3")):
            monkeypatch.setenv(twin.VARIABLE, "native")
            found = verify_on(base, ALL_PAIRS, rules, reasons=False)
            monkeypatch.setenv(twin.VARIABLE, "python")
            for a, b in zip(found, verify_on(base, ALL_PAIRS, rules, reasons=False), strict=True):
                assert_same(a.reachable_set, b.reachable_set)
                count += a.first_empty_step is None
    return count


@needs_native
def test_random_scenes_with_all_pairs_and_rules(monkeypatch: pytest.MonkeyPatch) -> None:
    assert _scenes(range(20), monkeypatch) > 100


@needs_native
@pytest.mark.soundness
def test_two_thousand_random_scenes(monkeypatch: pytest.MonkeyPatch) -> None:
    assert _scenes(range(1000, 3000), monkeypatch) > 10_000


@needs_native
def test_threads_do_not_meet(native: None) -> None:
    some = [problem(seed) for seed in range(60)]
    expected = [kernel.reachable_set(p) for p in some]
    with ThreadPoolExecutor(8) as pool:
        for _ in range(5):
            for found, right in zip(pool.map(reachable_set, some), expected, strict=True):
                assert_same(found, right)


@needs_native
def test_a_set_goes_to_other_processes(native: None) -> None:
    some = next(p for p in map(problem, range(100)) if p.answers and not _own(p))
    found = reachable_set(some)
    assert_same(reachable_set(pickle.loads(pickle.dumps(some))), kernel.reachable_set(some))
    again = pickle.loads(pickle.dumps(found))
    assert again.steps == tuple(found.steps)
    assert again.first_empty_step == found.first_empty_step
    assert found.steps[0:2] == tuple(found.steps)[0:2]


def _own(some: object) -> bool:
    return any(callable(a) and not hasattr(a, "__dataclass_fields__") for a in some.answers)


@needs_native
def test_an_error_in_an_answer_of_a_user_is_no_verdict(native: None) -> None:
    def broken(*asked: object) -> object:
        raise ZeroDivisionError("mine")

    some = next(p for p in map(problem, range(50)) if len(p.answers) == 1 and p.horizon > 1)
    move = Move(0, ((0, True),), (-1.0, 1.0))
    every = (frozenset({0}),) * (some.horizon + 2)
    moves = replace(some.moves, initial=0, moves=((move,),), final=((move,),), live=every)
    free = tuple(np.zeros_like(mask) for mask in some.forbidden)
    some = replace(some, moves=moves, answers=(broken,), forbidden=free, lon=[(some.lattice.s0, 1)])
    some = replace(some, lat=[(some.lattice.d0, 0.0)])
    with pytest.raises(ZeroDivisionError, match="mine"):
        kernel.reachable_set(some)
    with pytest.raises(ZeroDivisionError, match="mine"):
        reachable_set(some)


@needs_native
def test_parts_that_do_not_fit_together_are_refused(native: None) -> None:
    some = next(p for p in map(problem, range(50)) if len(p.answers) > 1 and p.horizon > 1)
    moves = some.moves
    low = Move(0, ((-1, True),), (0.0, 0.0))
    wrong = [
        replace(some, forbidden=some.forbidden[:-1]),
        replace(some, horizon=-1),
        replace(some, lon=[]),
        replace(some, lat=[]),
        replace(some, answers=()),
        replace(some, moves=replace(moves, initial=len(moves.moves))),
        replace(some, moves=replace(moves, initial=-1)),
        replace(some, moves=replace(moves, final=moves.final[:-1])),
        replace(some, moves=replace(moves, live=moves.live[:1])),
        replace(some, moves=replace(moves, moves=((Move(9, (), (0, 0)),),) * len(moves.moves))),
        replace(some, moves=replace(moves, final=((low,),) * len(moves.moves))),
    ]
    free, literal = (Move(0, (), (0.0, 0.0)),), (Move(0, ((0, True),), (0.0, 0.0)),)
    rows = {"moves": (free,) * len(moves.moves), "final": (literal,) * len(moves.moves)}
    wrong[4] = replace(wrong[4], moves=replace(moves, **rows))
    for each in wrong:
        with pytest.raises(ValueError, match="fit together"):
            reachable_set(each)
    with pytest.raises(ValueError, match="mask does not fit"):
        reachable_set(replace(some, forbidden=tuple(m[:, :-1] for m in some.forbidden)))


def test_the_choice_of_a_kernel(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(twin.VARIABLE, "python")
    assert twin.chosen() == "python"
    monkeypatch.setenv(twin.VARIABLE, "rust")
    with pytest.raises(SettingsError, match="SANDRA_KERNEL=rust: choose python or native"):
        twin.chosen()
    monkeypatch.delenv(twin.VARIABLE)
    assert twin.chosen() == ("python" if twin.native is None else "native")
    monkeypatch.setattr(twin, "native", None)
    assert twin.chosen() == "python"
    monkeypatch.setenv(twin.VARIABLE, "native")
    with pytest.raises(SettingsError, match="was not built"):
        twin.chosen()


@needs_native
def test_a_kernel_of_other_sources_is_not_used(tmp_path: Path) -> None:
    here = Path(twin.__file__).with_name("native")
    assert twin.built(here) is twin.native
    assert twin.built(tmp_path) is twin.native  # installed without sources
    for path in here.glob("*.?pp"):
        (tmp_path / path.name).write_bytes(path.read_bytes())
    assert twin.built(tmp_path) is twin.native
    with (tmp_path / "kernel.hpp").open("a") as file:
        file.write("// changed")
    with pytest.warns(RuntimeWarning, match="other sources"):
        assert twin.built(tmp_path) is None


@pytest.mark.parametrize("name", ["python", pytest.param("native", marks=needs_native)])
def test_both_kernels_are_asked_for_by_name(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(twin.VARIABLE, name)
    found = reachable_set(problem(3))
    assert isinstance(found.steps, tuple) == (name == "python")
