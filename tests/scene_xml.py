"""CommonRoad XML written by hand, so that each test sees exactly what it is about."""

from collections.abc import Iterable
from dataclasses import dataclass, field


def points(line: Iterable[tuple[float, float]]) -> str:
    return "".join(f"<point><x>{x}</x><y>{y}</y></point>" for x, y in line)


def lanelet(
    id: int,
    left: Iterable[tuple[float, float]],
    right: Iterable[tuple[float, float]],
    *,
    successors: Iterable[int] = (),
    predecessors: Iterable[int] = (),
    adjacent_left: tuple[int, str] | None = None,
    adjacent_right: tuple[int, str] | None = None,
    kind: str = "unknown",
    signs: Iterable[int] = (),
    lights: Iterable[int] = (),
    stop_line: str = "",
) -> str:
    """One lanelet element; adjacent lanelets as (id, "same" or "opposite")."""
    sides = (("Left", adjacent_left), ("Right", adjacent_right))
    return (
        f'<lanelet id="{id}"><leftBound>{points(left)}</leftBound>'
        f"<rightBound>{points(right)}</rightBound>"
        + "".join(f'<predecessor ref="{i}"/>' for i in predecessors)
        + "".join(f'<successor ref="{i}"/>' for i in successors)
        + "".join(
            f'<adjacent{name} ref="{to[0]}" drivingDir="{to[1]}"/>' for name, to in sides if to
        )
        + stop_line
        + f"<laneletType>{kind}</laneletType>"
        + "".join(f'<trafficSignRef ref="{i}"/>' for i in signs)
        + "".join(f'<trafficLightRef ref="{i}"/>' for i in lights)
        + "</lanelet>"
    )


def straight(id: int, x0: float, x1: float, y: float, *, back: bool = False, **rest: object) -> str:
    """A lanelet 4 m wide along x, or against it."""
    xs = [x0, (x0 + x1) / 2, x1]
    left, right = [(x, y + 2.0) for x in xs], [(x, y - 2.0) for x in xs]
    if back:
        left, right = right[::-1], left[::-1]
    return lanelet(id, left, right, **rest)  # type: ignore[arg-type]


def state(tag: str, step: int | str, x: float | str, y: float, **values: float | str) -> str:
    """A state element; values are numbers or XML."""
    inner = "".join(
        f"<{name}>{v if isinstance(v, str) else f'<exact>{v}</exact>'}</{name}>"
        for name, v in values.items()
    )
    at = f"<point><x>{x}</x><y>{y}</y></point>"
    return f"<{tag}><time><exact>{step}</exact></time><position>{at}</position>{inner}</{tag}>"


def car(id: int, *states: str, shape: str = "", kind: str = "car", rest: str = "") -> str:
    """A dynamic obstacle: the first state is the initial one, the others its trajectory."""
    shape = shape or "<rectangle><length>4.5</length><width>1.8</width></rectangle>"
    trajectory = f"<trajectory>{''.join(states[1:])}</trajectory>" if len(states) > 1 else ""
    return (
        f'<dynamicObstacle id="{id}"><type>{kind}</type><shape>{shape}</shape>'
        f"{states[0]}{trajectory}{rest}</dynamicObstacle>"
    )


def max_speed(id: int, value: float) -> str:
    return (
        f'<trafficSign id="{id}"><trafficSignElement><trafficSignID>274</trafficSignID>'
        f"<additionalValue>{value}</additionalValue></trafficSignElement></trafficSign>"
    )


ROAD = (
    straight(1, -100, 0, 0.0, successors=[2], adjacent_left=(3, "same")),
    straight(2, 0, 500, 0.0, predecessors=[1], adjacent_left=(4, "same")),
    straight(3, -100, 0, 4.0, successors=[4], adjacent_right=(1, "same")),
    straight(4, 0, 500, 4.0, predecessors=[3], adjacent_right=(2, "same")),
)
"""Two lanes along x, the right one around y = 0."""


@dataclass(frozen=True)
class Scenario:
    """The parts of a scenario file; `xml` puts them together."""

    lanelets: tuple[str, ...] = ROAD
    obstacles: tuple[str, ...] = ()
    others: tuple[str, ...] = ()
    initial: str = state("initialState", 0, 0.0, 0.0, orientation=0.0, velocity=10.0)
    goal: str = (
        "<goalState><time><intervalStart>0</intervalStart><intervalEnd>20</intervalEnd></time>"
        "</goalState>"
    )
    problems: tuple[str, ...] | None = None
    dt: str = "0.1"
    id: str = "DEU_Test-1_1_T-1"
    header: str = "<scenarioTags/>"
    version: str = "2020a"
    attributes: dict[str, str] = field(default_factory=dict)

    def xml(self) -> str:
        problems = self.problems
        if problems is None:
            problems = (f'<planningProblem id="900">{self.initial}{self.goal}</planningProblem>',)
        extra = "".join(f' {name}="{value}"' for name, value in self.attributes.items())
        return (
            f'<?xml version="1.0" encoding="UTF-8"?><commonRoad timeStepSize="{self.dt}" '
            f'commonRoadVersion="{self.version}" author="a" affiliation="b" source="c" '
            f'benchmarkID="{self.id}" date="2026-01-01"{extra}>{self.header}'
            + "".join((*self.lanelets, *self.others, *self.obstacles, *problems))
            + "</commonRoad>"
        )
