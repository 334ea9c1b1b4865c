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


def make(duration: float = 30.0) -> gymnasium.Env:
    """The environment as it comes; episodes last `duration` [s]."""
    return Quick(gymnasium.make(ENVIRONMENT, config={"duration": duration}))
