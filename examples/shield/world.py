"""The traffic in which the agent learns, and in which it drives with and without the shield."""

import gymnasium
import highway_env  # noqa: F401  (registers its environments)

from sandra.simulation.road import QuickRoad

ENVIRONMENT = "highway-fast-v0"
"""Three lanes, 20 others, one action a second."""


class Quick(gymnasium.Wrapper):
    """The same traffic in less time (see `sandra.simulation.road`)."""

    def reset(self, **arguments):
        result = self.env.reset(**arguments)
        self.unwrapped.road = QuickRoad.of(self.unwrapped.road)
        return result


def make(duration: float = 30.0, density: float = 1.0) -> gymnasium.Env:
    """Episodes last `duration` [s]; `density` 1 is the environment's own, in which is learnt."""
    config = {"duration": duration, "vehicles_density": density}
    return Quick(gymnasium.make(ENVIRONMENT, config=config))
