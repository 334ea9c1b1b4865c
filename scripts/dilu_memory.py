"""Writes the memory that the DiLu baseline starts with: situations of our own simulation.

A driver by rules drives episodes whose seeds no evaluation uses. Where it did well, i.e. the
episode went on for `WELL` steps without collision, the situation, the reasons of its rules in
words, and its action may become an experience. Of those, the ones that differ most are kept, so
many of each action. Takes half a minute.

    python scripts/dilu_memory.py [--check]
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator
from pathlib import Path

from sandra.rankers.dilu import Car, Experience, HashedWords, LaneView, View
from sandra.rankers.dilu.memory import dump
from sandra.simulation import ACTIONS, Traffic, highway
from sandra.simulation.dilu import view
from sandra.simulation.highway import SETTINGS

TARGET = Path(__file__).parents[1] / "src/sandra/rankers/dilu/memory.json"
SEEDS = range(100_001, 100_009)
TRAFFIC: dict[int | str, Traffic] = {**SETTINGS, "light": SETTINGS[1].replace(density=1.0)}
"""The paper's settings, and one in which there is room to drive faster."""
STEPS = 40
WELL = 15
"""Decision steps: 3 s."""
QUOTA = {"LANE_LEFT": 4, "IDLE": 4, "LANE_RIGHT": 4, "FASTER": 4, "SLOWER": 5}
FREE = 10.0
"""Gap that a lane must have ahead and behind [m], and more where the gap closes."""
TIME = 3.0
"""So long a closing gap must last beside that [s]."""
CLOSE, NEAR, FAR = 1.0, 2.0, 2.0
"""Time gaps to the car ahead [s]."""
BRAKING, SOON = 1.0, 4.0
"""Something is done about a car ahead that demands more braking, or is met sooner [m/s^2, s]."""


def decide(seen: View) -> tuple[str, str]:
    """The action of the rules, and their reasons in words."""
    if seen.changing_to is not None:
        words = f"I am on my way to lane {seen.changing_to}, and finish that first."
        return "IDLE", f"{words} Another press would take me one lane farther."
    reasons, urgent, slow, room = _ahead(seen)
    if urgent or slow:
        for side, lane in (("left", seen.left), ("right", seen.right)):
            said, better = _lane(seen, side, lane)
            reasons.append(said)
            if better:
                reasons.append(f"So I change to the {side}.")
                return f"LANE_{side.upper()}", " ".join(reasons)
    if urgent:
        reasons.append("Neither side helps, so I must slow down before the gap is gone.")
        return "SLOWER", " ".join(reasons)
    if room and seen.faster > seen.target:
        reasons.append(f"There is room to drive faster, so I set {seen.faster:.1f} m/s.")
        return "FASTER", " ".join(reasons)
    if room:
        reasons.append("I am set to the highest speed already, so I leave things as they are.")
        return "IDLE", " ".join(reasons)
    reasons.append("Nothing is gained by a change now, so I leave things as they are.")
    return "IDLE", " ".join(reasons)


def _ahead(seen: View) -> tuple[list[str], bool, bool, bool]:
    """On the car ahead: words, whether it is urgent, whether it is slow, whether there is room."""
    car = seen.own.ahead
    if car is None:
        return ["Nobody is ahead of me in my lane."], False, False, True
    gap, closing = max(car.gap, 0.1), seen.speed - car.speed
    time_gap = gap / max(seen.speed, 1.0)
    words = f"The car ahead of me is {gap:.1f} m away, {time_gap:.1f} s at my speed."
    if closing > 0.5:
        needed = closing**2 / (2 * gap)
        words += (
            f" I am {closing:.1f} m/s faster, so the gap is gone in {gap / closing:.1f} s; "
            f"to avoid that I would have to brake by {needed:.1f} m/s²."
        )
    else:
        needed = 0.0
        words += " I am not faster than it, so the gap does not close."
    if car.acceleration < -1.0:
        words += f" It is braking by {-car.acceleration:.1f} m/s², which makes things worse."
    meets = closing > 0.5 and gap / closing < SOON
    braking = closing > 0.0 or car.acceleration < -1.0
    urgent = needed > BRAKING or meets or (time_gap < CLOSE and braking)
    slow = time_gap < NEAR and closing > 1.0
    room = time_gap > FAR and closing < 1.0 and car.acceleration > -1.0
    return [words], urgent, slow, room


def _lane(seen: View, side: str, lane: LaneView | None) -> tuple[str, bool]:
    """On a change to one side: words, and whether it is better there."""
    if lane is None:
        return f"There is no lane on my {side}.", False
    for place, car in (("ahead", lane.ahead), ("behind", lane.behind)):
        if car is None:
            continue
        closing = seen.speed - car.speed if place == "ahead" else car.speed - seen.speed
        if car.gap <= 0.0:
            return f"On the {side} somebody is right beside me.", False
        if car.gap < FREE + TIME * max(closing, 0.0):
            return (
                f"On the {side} the car {place} is {car.gap:.1f} m away"
                + (f" and coming {closing:.1f} m/s nearer" if closing > 0.5 else "")
                + ", which is too little room.",
                False,
            )
    here = seen.own.ahead
    assert here is not None
    if lane.ahead is None:
        return f"On the {side} nobody is ahead, and there is room to change.", True
    if _better(lane.ahead, here):
        return (
            f"On the {side} the next car is {lane.ahead.gap:.1f} m ahead at "
            f"{lane.ahead.speed:.1f} m/s, which is better than here, and there is room to change.",
            True,
        )
    return f"On the {side} it would be no better than here.", False


def _better(there: Car, here: Car) -> bool:
    return there.gap + TIME * there.speed > here.gap + TIME * here.speed + FREE


def episode(name: int | str, seed: int) -> Iterator[Experience]:
    """What happened to the rules in one episode, where it went well."""
    world = highway(TRAFFIC[name])
    world.reset(seed)
    seen: list[tuple[View, str, str]] = []
    while len(seen) < STEPS and not world.ego.crashed:
        here = view(world)
        action, reasons = decide(here)
        seen.append((here, action, reasons))
        world.step(action)
    for step, (here, action, reasons) in enumerate(seen[: len(seen) - WELL]):
        answer = f"{reasons}\n#### {ACTIONS.index(action)}"
        source = f"setting {name}, seed {seed}, step {step}"
        yield Experience(here.situation(), here.choices(), answer, source)


def chosen(items: list[Experience]) -> list[Experience]:
    """So many of each action, each the least like those before it."""
    vectors = HashedWords().embed([item.situation for item in items])
    taken: list[int] = []
    for action, quota in QUOTA.items():
        mine = [
            i for i, e in enumerate(items) if e.answer.endswith(f"#### {ACTIONS.index(action)}")
        ]
        for _ in range(min(quota, len(mine))):
            rest = [i for i in mine if i not in taken]
            likeness = {
                i: max((float(vectors[i] @ vectors[j]) for j in taken), default=0.0) for i in rest
            }
            taken.append(min(rest, key=lambda i: round(likeness[i], 9)))
    return [items[i] for i in taken]


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--check", action="store_true", help="only say whether it is up to date")
    items = [item for name in TRAFFIC for seed in SEEDS for item in episode(name, seed)]
    text = dump(chosen(items))
    if parser.parse_args().check:
        same = TARGET.exists() and TARGET.read_text(encoding="utf-8") == text
        print(f"{TARGET.name} is {'up to date' if same else 'not what this script writes'}")
        return 0 if same else 1
    TARGET.write_text(text, encoding="utf-8")
    print(f"wrote {TARGET.name}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
