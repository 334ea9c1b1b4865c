"""Certificates on a straight road of two lanes, made by hand; the ego in the right one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from certified import constant, made
from prediction.traffic import car, scene, straight_road
from sandra.certificate import Certificate, check
from sandra.scene.types import Obstacle, Scene, State
from sandra.settings import Assumptions, Settings

RIGHT, LEFT = 1.75, 5.25


def two_lanes(*cars: Obstacle, speed: float = 10.0) -> Scene:
    """The ego at x = -100 in the right lane."""
    return scene(straight_road(2), cars, State(-100.0, RIGHT, 0.0, speed), current=(11, 12), dt=0.1)


def stopping(now: Scene, wait: float = 0.0, braking: float = 5.0, **options: object) -> Certificate:
    """Keep the lane, go on for `wait` [s] after the decision, then brake to a standstill."""
    speed = now.ego.state.speed
    going = constant(0.0, round(wait / 0.05))
    stop = constant(-braking, round(speed / braking / 0.05))
    return made(now, stop=np.vstack([going, stop]), rules=(), **options)


def sound(c: Certificate) -> Certificate:
    """The same, if the checker accepts it."""
    report = check(c)
    assert report.accepted, report
    return c


def leader(x: float = -100.0 + 13.0, speed: float = 10.0) -> Obstacle:
    """A car ahead in the ego's lane; the default one is as near as the checker accepts, nearly."""
    return car(7, x, RIGHT, speed=speed)


def with_assumptions(c: Certificate, **changes: float) -> Certificate:
    """The same certificate, played with other bounds than those that it was made with."""
    weaker = replace(c.settings.assumptions, **changes)
    return replace(c, settings=c.settings.replace(assumptions=weaker))


def without(c: Certificate, *names: str) -> Certificate:
    """The same certificate, with assumptions struck off the lists of all participants."""
    others = tuple(
        replace(o, assumptions=tuple(a for a in o.assumptions if a not in names))
        for o in c.obstacles
    )
    return replace(c, obstacles=others)


def narrow(**changes: float) -> Settings:
    """Settings whose assumptions promise less freedom of the others."""
    return Settings(assumptions=Assumptions(**changes))
