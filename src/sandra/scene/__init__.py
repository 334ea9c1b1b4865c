"""The scene: what the car knows about where it is. `load` makes one from a CommonRoad file."""

from sandra.scene.commonroad import load
from sandra.scene.frame import Frame
from sandra.scene.types import (
    Ego,
    Lane,
    Lanelet,
    Obstacle,
    Region,
    Scene,
    State,
    TrafficLight,
    TrafficSign,
)

__all__ = [
    "Ego",
    "Frame",
    "Lane",
    "Lanelet",
    "Obstacle",
    "Region",
    "Scene",
    "State",
    "TrafficLight",
    "TrafficSign",
    "load",
]
