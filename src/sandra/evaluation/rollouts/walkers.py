"""Those who may go anywhere: pedestrians, bicycles, unknown types, vehicles off their lanes."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sandra.evaluation.rollouts.actors import Actor
from sandra.evaluation.rollouts.adversary import GREEDY, RANDOM, Plans
from sandra.evaluation.rollouts.ego import Drive
from sandra.evaluation.rollouts.traffic import NEARLY, Motion

Array = NDArray[np.float64]


def wander(actors: list[Actor], plans: Plans, drive: Drive) -> Motion:
    """Move N points with bounded speed and acceleration; `actors` has one entry per row.

    Those with a bounded heading turn no tighter than they may, and do not reverse.
    """
    n, steps, h = len(actors), len(drive.states), drive.step
    a_max, v_max = (np.array([getattr(x, name) for x in actors]) for name in ("a_max", "v_max"))
    radius = np.array([x.turning_radius for x in actors])
    bounded = radius > 0.0
    since = np.array([x.appears for x in actors])
    p = np.array([[x.start.x, x.start.y] for x in actors])
    psi = np.array([x.start.heading for x in actors])
    known = np.array([x.speed_is_known for x in actors])
    speed = np.where(known, [x.start.speed for x in actors], plans.speed * v_max)
    course = np.where(known | bounded, psi, plans.turn)
    v = speed[:, None] * np.column_stack([np.cos(course), np.sin(course)])
    position, heading, velocity = (np.empty((steps, n, 2)), np.empty((steps, n)),
                                   np.empty((steps, n, 2)))  # fmt: skip
    ego = drive.states[:, :2]
    for k in range(steps):
        # A body without bound on its heading may point anywhere after its first moment.
        turned = np.where(~bounded & (k > since), plans.turn, psi)
        position[k], heading[k], velocity[k] = p, turned, v
        if k == steps - 1:
            break
        push, side = plans.piece(k * h)
        angle = np.pi * side
        size = np.where(plans.kind == RANDOM, np.abs(push), 1.0)
        wish = (size * a_max)[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])
        lead = np.where(np.isinf(plans.lead), 1.0, plans.lead)
        later = np.minimum(k + np.round(lead / h).astype(int), steps - 1)
        time = np.maximum((later - k) * h, h)[:, None]
        chase = 2 * (ego[later] - p - v * time) / time**2
        # All but the random ones go for the ego half of the time.
        hunts = (plans.kind >= GREEDY) | ((plans.kind != RANDOM) & (push > 0))
        wish = np.where(hunts[:, None], chase, wish)
        wish *= np.minimum(1.0, a_max / np.maximum(np.hypot(*wish.T), 1e-9))[:, None] * NEARLY
        speed = np.hypot(*v.T)
        if bounded.any():
            ahead = np.column_stack([np.cos(psi), np.sin(psi)])
            left = np.column_stack([-np.sin(psi), np.cos(psi)])
            a_side = (wish * left).sum(axis=1)
            most = 0.9 * np.minimum(a_max, speed**2 / np.maximum(radius, 0.5))
            a_side = np.clip(a_side, -most, most)
            rest = np.sqrt(np.maximum((NEARLY * a_max) ** 2 - a_side**2, 0.0))
            a_long = np.clip((wish * ahead).sum(axis=1), -rest, rest)
            a_long = np.maximum(a_long, -speed / h)
            then = speed + a_long * h
            tight = np.maximum(radius, 0.5)
            most = np.tan(np.minimum(0.95 * h * (speed + then) / 2 / tight, 1.0)) * then / h
            a_side = np.clip(a_side, -most, most)
            vehicle = a_long[:, None] * ahead + a_side[:, None] * left
            wish = np.where(bounded[:, None], vehicle, wish)
        new = v + h * wish
        fast = np.hypot(*new.T)
        # The projection onto the disc of allowed speeds moves no two points farther apart.
        new *= np.minimum(1.0, v_max / np.maximum(fast, 1e-9))[:, None]
        moving = (k >= since)[:, None]
        new = np.where(moving, new, v)
        p = np.where(moving, p + h * (v + new) / 2, p)
        turns = bounded & (np.hypot(*new.T) > 1e-6)
        psi = np.where(turns, np.arctan2(new[:, 1], new[:, 0]), psi)
        v = new
    nobody = np.zeros((steps, n), dtype=bool)
    return Motion(position, heading, velocity, since, np.full(n, steps), nobody)
