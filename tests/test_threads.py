"""Decisions in many threads at once are those of one after the other, bit for bit."""

from __future__ import annotations

import dataclasses
import hashlib
import logging
import sys
import warnings
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from enum import Enum
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely

import sandra
from sandra.certify import Basis, certify
from sandra.logic.translation import _translate
from sandra.planning.prepared import Prepared
from sandra.rankers import create
from sandra.reach import ground, verify_pair
from sandra.reach.moves import moves_of
from sandra.settings import Settings
from slow_server import Pace, slow_server

RULES = ("R_G1", "R_G2", "R_G3")
JOBS: tuple[tuple[str, dict[str, Any]], ...] = (
    ("intersection", {"horizon": 10, "walk": "all"}),
    ("intersection", {"horizon": 8, "prediction": "set-based", "rules": RULES}),
    ("merge", {"horizon": 8, "mode": "verify-first", "accept": "reachable", "rules": RULES}),
    ("merge", {"horizon": 6, "settings": Settings(a_lon_min=-4.0, cell_s=0.5), "walk": "all"}),
    ("roadworks", {"horizon": 7, "mode": "verify-first", "rules": ("G(v <= 12)",)}),
    ("nothing-safe", {"horizon": 12, "prediction": "constant-velocity", "walk": "all"}),
)
"""Different scenes and settings, and the same scene under different ones."""
PLAIN = (str, int, float, bytes, Path)
LEFT_OUT = {"duration_s", "durations_s", "answers"}
"""Times, and what a ground remembers of questions that others have asked."""


def digest(thing: Any) -> str:
    """Of all that a result holds, arrays by their bytes, without the times that it took."""
    found = hashlib.sha256()
    for part in _parts(thing, set()):
        found.update(part)
    return found.hexdigest()


def _parts(thing: Any, above: set[int]) -> Iterator[bytes]:
    assert id(thing) not in above
    if isinstance(thing, np.ndarray):
        yield f"{thing.dtype}{thing.shape}".encode() + np.ascontiguousarray(thing).tobytes()
    elif isinstance(thing, Prepared):
        yield thing._geometry.wkb
    elif isinstance(thing, shapely.Geometry):
        yield thing.wkb
    elif isinstance(thing, Enum) or thing is None or isinstance(thing, PLAIN):
        yield repr(thing).encode() + b";"
    elif isinstance(thing, Sequence):
        for each in thing:
            yield from _parts(each, above | {id(thing)})
    elif isinstance(thing, set | frozenset):
        yield from _parts(sorted(thing, key=repr), above)
    elif hasattr(thing, "items"):
        for key, value in thing.items():
            yield repr(key).encode()
            yield from _parts(value, above | {id(thing)})
    elif dataclasses.is_dataclass(thing):
        yield type(thing).__name__.encode()
        for field in dataclasses.fields(thing):
            if field.name not in LEFT_OUT:
                yield from _parts(getattr(thing, field.name), above | {id(thing)})
    elif isinstance(thing, np.generic):
        yield thing.tobytes()
    elif callable(thing):  # a search that is made when it is asked for
        yield from _parts(thing(), above)
    else:
        raise TypeError(f"what is a {type(thing).__name__}?")


def run(scene: sandra.Scene, options: dict[str, Any]) -> str:
    return digest(sandra.decide(scene, "rules", "drive faster", **options))


@pytest.fixture
def eager() -> Iterator[None]:
    """Threads take turns every few microseconds."""
    before = sys.getswitchinterval()
    sys.setswitchinterval(1e-5)
    yield
    sys.setswitchinterval(before)


def test_a_digest_sees_the_last_bit() -> None:
    scene = sandra.load(sandra.example("roadworks"))
    state = scene.ego.state
    moved = dataclasses.replace(state, x=np.nextafter(state.x, np.inf))
    other = dataclasses.replace(scene, ego=dataclasses.replace(scene.ego, state=moved))
    assert digest(scene) != digest(other)
    assert digest(scene) == digest(sandra.load(sandra.example("roadworks")))


def test_many_decisions_at_once_are_those_of_one_after_the_other(eager: None) -> None:
    scenes = {name: sandra.load(sandra.example(name)) for name, _ in JOBS}
    alone = [run(scenes[name], options) for name, options in JOBS]
    assert len(set(alone)) == len(JOBS)
    before = {name: digest(scene) for name, scene in scenes.items()}
    # The threads begin with empty caches, too.
    moves_of.cache_clear()
    _translate.cache_clear()
    with ThreadPoolExecutor(len(JOBS)) as pool:
        tasks = [pool.submit(run, scenes[name], options) for name, options in JOBS]
        together = [task.result() for task in tasks]
    assert together == alone
    # Nobody has written into what all of them read.
    assert {name: digest(scene) for name, scene in scenes.items()} == before


def test_one_ground_serves_many_threads(eager: None) -> None:
    scene = sandra.load(sandra.example("merge"))
    settings = Settings(horizon=8)
    base = ground(scene, sandra.predict(scene, "set-based", 8, settings), settings)
    before = digest(base)

    def judged(pair: sandra.ActionPair) -> str:
        return digest(verify_pair(base, pair, RULES))

    alone = [judged(pair) for pair in sandra.ALL_PAIRS]
    with ThreadPoolExecutor(6) as pool:
        assert list(pool.map(judged, sandra.ALL_PAIRS * 2)) == alone * 2
    assert digest(base) == before


def test_one_basis_serves_many_threads(eager: None) -> None:
    """Their areas are shared: unguarded, the process crashes here."""
    scene = sandra.load(sandra.example("merge"))
    settings = Settings(horizon=8)
    base = ground(scene, sandra.predict(scene, "set-based", 8, settings), settings)
    verdicts = [verify_pair(base, pair, RULES) for pair in sandra.ALL_PAIRS]
    alone = [digest(certify(Basis.of(base), verdict, RULES)) for verdict in verdicts]
    basis = Basis.of(base)
    with ThreadPoolExecutor(6) as pool:
        together = list(pool.map(lambda v: digest(certify(basis, v, RULES)), verdicts))
    assert together == alone


def test_loading_in_many_threads_leaves_no_filter_behind(eager: None) -> None:
    logger = logging.getLogger("commonroad")
    level, filters = logger.level, list(warnings.filters)
    names = [name for name, _ in JOBS] * 3
    with ThreadPoolExecutor(6) as pool:
        found = list(pool.map(lambda name: digest(sandra.load(sandra.example(name))), names))
    assert found[: len(JOBS)] * 3 == found
    assert logger.level == level
    assert list(warnings.filters) == filters


def test_one_model_is_asked_by_many_threads() -> None:
    scenes = {name: sandra.load(sandra.example(name)) for name in ("merge", "roadworks")}
    with slow_server(Pace(reason=0.2, rank=0.1)) as server:
        ranker = create("openai:m", base_url=server.url)

        def asked(name: str) -> str:
            decision = sandra.decide(scenes[name], ranker, horizon=6, mode="verify-first")
            assert decision.ranking.failure is None
            return digest(decision)

        names = ["merge", "roadworks"] * 3
        with ThreadPoolExecutor(6) as pool:
            found = list(pool.map(asked, names))
    assert found == found[:2] * 3
    assert found[0] != found[1]
