"""Rankings of recorded MONA prompts, as a file for `sandra evaluate rankings`.

    python scripts/recorded_prompts.py mona_prompts.parquet mona_llm_rankings.csv --out ours.csv
    sandra evaluate rankings ours.csv

The prompts are those that the paper's authors recorded: text, without the scenarios behind them.
They are ranked twice: as recorded, and with the same facts told in our sentences, in which
orientations are relative to the ego's. Labels come from the recorded rankings. Accelerations and
steering angles are all 0 in these prompts. Whatever is not told (a road's type, a speed limit, who
is beside whom by how much) is not known. Needs pyarrow.
"""

from __future__ import annotations

import argparse
import csv
import re
from collections.abc import Iterator
from pathlib import Path

from sandra.actions import ActionPair, Lateral, Longitudinal
from sandra.describe import Prompt, PromptOptions
from sandra.describe.obstacle_wording import obstacles_text
from sandra.describe.schema import answer_schema
from sandra.describe.types import ObstacleFacts, Situation
from sandra.describe.wording import system_text
from sandra.rankers import create
from sandra.settings import Settings

CUT = "Here is an overview of your environment:"
STATE = re.compile(r"velocity is (-?[\d.]+) m/s, orientation is (-?[\d.]+) rad")
OBSTACLE = re.compile(
    r"- (?P<kind>\w+) (?P<id>\d+): It is driving on the (?P<lane>same|left|right)\S* .*?is "
    r"(?:(?P<gap>[\d.]+) meters (?P<side>behind|in front)|(?P<beside>directly aligned))"
    r".*?velocity is (?P<speed>-?[\d.]+) m/s, orientation is (?P<heading>-?[\d.]+) rad"
    r".*?time-to-collision is (?P<ttc>inf|-?[\d.]+) sec"
)
SETTINGS = Settings(horizon=5)
SECONDS = 1.0
"""For which a label of these records holds."""


def obstacles_of(text: str, heading: float) -> Iterator[ObstacleFacts]:
    for found in OBSTACLE.finditer(text):
        lane, gap = found["lane"], float(found["gap"] or 0.0)
        aside = {"same": 0.0, "left": 3.5, "right": -3.5}[lane]
        yield ObstacleFacts(
            id=int(found["id"]),
            kind=found["kind"],
            is_static=False,
            relation=lane,
            same_direction=True,
            gap=-gap if found["side"] == "behind" else gap,
            lateral_gap=aside,
            speed=float(found["speed"]),
            acceleration=0.0,
            heading=float(found["heading"]) - heading,
            steering_angle=None,
            time_to_collision=float(found["ttc"]),
            in_ego_lane=lane == "same",
        )


def prompts_of(recorded: str) -> tuple[Prompt, Prompt]:
    """As recorded, and in our sentences."""
    system, user = recorded.split(CUT)
    lateral = [Lateral.FOLLOW_LANE]
    lateral += [
        x for x in (Lateral.LEFT_LANE, Lateral.RIGHT_LANE) if f"  - {x.value[:-5]}\n" in system
    ]
    feasible = tuple(ActionPair(lon, lat) for lon in Longitudinal for lat in lateral)
    state = STATE.search(user)
    assert state is not None
    speed, heading = float(state[1]), float(state[2])
    obstacles = sorted(obstacles_of(user, heading), key=lambda o: abs(o.gap))
    facts = Situation(
        scenario="",
        road_type="unknown",
        country=None,
        weather=None,
        speed=speed,
        acceleration=0.0,
        heading=0.0,
        steering_angle=0.0,
        speed_limit=None,
        obstacles=tuple(obstacles),
        light=None,
        light_distance=None,
        feasible=feasible,
        command=None,
        past=(),
        horizon=SECONDS,
    )
    lanes = user.strip().split("\n")[0].strip()
    options = PromptOptions()
    words = options.templates
    told = [
        words.say("ego", "opening"),
        words.say("ego", "road_unknown", conditions=""),
        lanes,
        words.say("ego", "state", speed=speed, heading=0.0, steering=0.0, acceleration=0.0),
        words.say("ego", "no_limit"),
        obstacles_text(words, facts, SETTINGS, options),
    ]
    ours = Prompt(
        system=system_text(words, facts, tuple(Longitudinal), lateral, 3, SETTINGS),
        user="\n".join(told),
        schema=answer_schema(feasible, 3),
        k=3,
        longitudinal=tuple(Longitudinal),
        lateral=tuple(lateral),
        situation=facts,
    )
    theirs = Prompt(
        system=system.strip(),
        user=CUT + user,
        schema=ours.schema,
        k=3,
        longitudinal=ours.longitudinal,
        lateral=ours.lateral,
        situation=facts,
    )
    return theirs, ours


def recorded(path: Path) -> dict[str, str]:
    """By scenario, the text of its prompt."""
    from pyarrow.parquet import read_table

    columns = read_table(path).to_pydict()
    return dict(zip(columns["ScenarioID"], columns["prompt"], strict=True))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("prompts", type=Path, help="mona_prompts.parquet")
    parser.add_argument("rankings", type=Path, help="mona_llm_rankings.csv: whose labels")
    parser.add_argument("--ranker", action="append", help="default: embedded and rules")
    parser.add_argument("--out", type=Path, default=Path("recorded-prompts.csv"))
    arguments = parser.parse_args()
    asked = recorded(arguments.prompts)
    with arguments.rankings.open(encoding="utf-8") as file:
        labels = {r["scenario_id"]: (r["label_lon"], r["label_lat"]) for r in csv.DictReader(file)}
    places = [f"{part}{n}" for n in (1, 2, 3) for part in ("lon", "lat")]
    with arguments.out.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(["run", "scenario_id", "label_lon", "label_lat", *places, "failure"])
        for name in arguments.ranker or ["embedded", "rules"]:
            ranker = create(name)
            for scenario, text in asked.items():
                for how, prompt in zip(("recorded", "ours"), prompts_of(text), strict=True):
                    if name == "rules" and how == "recorded":
                        continue  # It reads no text.
                    found = ranker.rank(prompt, 30.0)
                    cells = [c for pair in found.pairs for c in str(pair).split(",")]
                    cells += [""] * (len(places) - len(cells))
                    failure = "" if found.failure is None else found.failure.value
                    writer.writerow(
                        [f"{name}, {how}", scenario, *labels[scenario], *cells, failure]
                    )
    print(f"written: {arguments.out}")


if __name__ == "__main__":
    main()
