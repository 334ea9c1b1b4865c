"""What is recorded: which traffic belongs to a seed, and to which split.

Both are functions of the seed alone, so a data set can be extended, and no seed is in two splits.
"""

from __future__ import annotations

import itertools
from dataclasses import asdict, dataclass
from functools import cache
from typing import Any

import numpy as np

from sandra.errors import SettingsError

ENVIRONMENTS = {
    "highway": "highway-v0",
    "merge": "merge-generic-v0",
    "roundabout": "roundabout-generic-v0",
    "intersection": "intersection-v0",
}
"""Names on the command line, and highway-env's own."""
DRIVERS = ("idm", "aggressive", "defensive", "mixed")
SPLITS = ("train", "validation", "test")
_OF_TEN = ("train",) * 8 + ("validation", "test")
"""Splits by the last digit of the seed."""
DT = 0.2
"""Between two recorded steps [s]: that of `sandra drive`."""


def split_of(seed: int) -> str:
    """The split of a seed: of ten in a row, eight are for training."""
    return _OF_TEN[seed % 10]


@dataclass(frozen=True, slots=True)
class Episode:
    """One recording, yet to be made. `density` is 1 for the library's default traffic."""

    seed: int
    environment: str
    density: float
    lanes: int
    drivers: str

    @property
    def split(self) -> str:
        return split_of(self.seed)

    @property
    def name(self) -> str:
        """Of the file, without its ending."""
        return f"{self.environment}-{self.seed:06d}"


@dataclass(frozen=True, slots=True)
class Recipe:
    """Which traffic is recorded, apart from the number of episodes.

    Args:
        lanes: per direction; at the intersection there is always one.
        seed: of the first episode; the others' follow it. duration: of each [s].
        warm_up: how long the traffic moves before it is recorded [s].

    Raises:
        SettingsError: a value that cannot be recorded.
    """

    environments: tuple[str, ...] = tuple(ENVIRONMENTS)
    densities: tuple[float, ...] = (0.75, 1.0, 1.5, 2.0)
    lanes: tuple[int, ...] = (2, 3, 4)
    drivers: tuple[str, ...] = DRIVERS
    seed: int = 0
    duration: float = 12.0
    warm_up: float = 2.0

    def __post_init__(self) -> None:
        for name, values, known in (
            ("environments", self.environments, tuple(ENVIRONMENTS)),
            ("drivers", self.drivers, DRIVERS),
        ):
            for value in values:
                if value not in known:
                    raise SettingsError(f"{name}: '{value}' is unknown; known: {', '.join(known)}")
        for name in ("environments", "densities", "lanes", "drivers"):
            if not getattr(self, name):
                raise SettingsError(f"{name}: name at least one")
        if not all(0.0 < value <= 5.0 for value in self.densities):
            raise SettingsError("densities: each must be above 0 and at most 5")
        if not all(1 <= value <= 8 for value in self.lanes):
            raise SettingsError("lanes: each must be from 1 to 8")
        if self.seed < 0:
            raise SettingsError(f"seed = {self.seed}: at least 0")
        if not DT <= self.duration <= 600.0 or not 0.0 <= self.warm_up <= 600.0:
            raise SettingsError(
                f"duration = {self.duration:g} s, warm_up = {self.warm_up:g} s: "
                f"from {DT} (warm_up: 0) to 600"
            )

    @property
    def steps(self) -> int:
        """Recorded steps after the first."""
        return round(self.duration / DT)

    def episodes(self, count: int) -> list[Episode]:
        """The first so many."""
        return [self.episode(seed) for seed in range(self.seed, self.seed + count)]

    def episode(self, seed: int) -> Episode:
        """The traffic of a seed: in each split, all combinations have their turn."""
        decade, digit = divmod(seed, 10)
        rank = 8 * decade + digit if digit < 8 else decade
        turn, which = divmod(rank, len(self.environments))
        environment = self.environments[which]
        found = _combinations(environment, self.densities, self.lanes, self.drivers)
        # The splits begin at different places, so that small ones are not all of the same traffic.
        turn += SPLITS.index(split_of(seed)) * len(found) // len(SPLITS)
        density, lanes, drivers = found[turn % len(found)]
        return Episode(seed, environment, density, lanes, drivers)

    def to_dict(self) -> dict[str, Any]:
        return {k: list(v) if isinstance(v, tuple) else v for k, v in asdict(self).items()}


@cache
def _combinations(
    environment: str,
    densities: tuple[float, ...],
    lanes: tuple[int, ...],
    drivers: tuple[str, ...],
) -> list[tuple[float, int, str]]:
    """In an order that is the same each time, and not that of the values."""
    if environment == "intersection":
        lanes = (1,)
    every = list(itertools.product(densities, lanes, drivers))
    order = np.random.default_rng(list(environment.encode())).permutation(len(every))
    return [every[i] for i in order]
