"""Bad input: each one line that says what, where and how to mend it."""

import logging
import os
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from sandra.errors import ScenarioError
from sandra.scene import load
from scene_xml import ROAD, Scenario, car, state, straight

Write = Callable[..., Path]


def message(path: Path | str, **options: int) -> str:
    with pytest.raises(ScenarioError) as caught:
        load(path, **options)  # type: ignore[arg-type]
    text = str(caught.value)
    assert str(path) in text
    assert "\n" not in text
    return text


def test_no_file_a_directory_an_empty_file(tmp_path: Path) -> None:
    assert "no such file" in message(tmp_path / "missing.xml")
    assert "is a directory" in message(tmp_path)
    empty = tmp_path / "empty.xml"
    empty.write_bytes(b"")
    assert "empty file" in message(empty)


@pytest.mark.parametrize(
    ("text", "what"),
    [
        ("hello", "neither XML nor protobuf"),
        ("<html></html>", "root is <html>"),
        ("<commonRoad", "not well-formed XML or truncated"),
        ("< no xml", "not well-formed"),
        ('<?xml version="1.0" encoding="no-such-code"?><commonRoad/>', "not well-formed"),
        ("<commonRoad/>", "commonRoadVersion 'None'"),
    ],
)
def test_not_commonroad(write: Write, text: str, what: str) -> None:
    assert what in message(write(text))


@pytest.mark.parametrize("share", [0.2, 0.5, 0.9, 0.999])
def test_truncated(write: Write, share: float) -> None:
    text = Scenario().xml()
    assert "truncated" in message(write(text[: int(share * len(text))]))


STATE = {"orientation": 0.0, "velocity": 10.0}


@pytest.mark.parametrize(
    ("parts", "what"),
    [
        ({"problems": ()}, "no planning problem"),
        ({"lanelets": ()}, "no lanelets"),
        ({"dt": "0"}, "dt = 0 must be"),
        ({"dt": "-0.1"}, "dt = -0.1 must be"),
        ({"dt": "nan"}, "dt = nan must be"),
        ({"dt": "fast"}, "dt = fast must be"),
        ({"version": "2017a"}, "not supported"),
        ({"initial": state("initialState", 0, 0.0, 99.0, **STATE)}, "off the road"),
        ({"initial": state("initialState", 0, "nan", 0.0, **STATE)}, "position x"),
        ({"initial": state("initialState", 0, "inf", 0.0, **STATE)}, "position x"),
        ({"initial": state("initialState", 0, "here", 0.0, **STATE)}, "position x"),
        ({"initial": state("initialState", 0, 0, 0, orientation=0, velocity="nan")}, "velocity"),
        (
            {"initial": state("initialState", 0, 0, 0, orientation=0, velocity=float("nan"))},
            "velocity is no finite number",
        ),
        (
            {"initial": state("initialState", 0, 0, 0, orientation=0, velocity=float("inf"))},
            "velocity is no finite number",
        ),
        (
            {"initial": state("initialState", 0, 0, 0, orientation=0, velocity=-3.0)},
            "-3.0 m/s is negative",
        ),
        ({"initial": state("initialState", 0, 0, 0, orientation=0)}, "no initial velocity"),
        ({"initial": state("initialState", 0, 0, 0, velocity=1)}, "no initial orientation"),
        ({"initial": ""}, "no initial time"),
        ({"obstacles": (car(5, state("initialState", 0, "nan", 0, **STATE)),)}, "5: initial state"),
        (
            {
                "obstacles": (
                    car(5, state("initialState", 0, 9, 0, **STATE), state("state", 1, "nan", 0)),
                )
            },
            "dynamicObstacle 5: state: position x",
        ),
        ({"obstacles": (car(5, state("initialState", 0, 9, 0), shape="<cube/>"),)}, "malformed"),
        (
            {"obstacles": (car(5, state("initialState", 0, 9, 0, **STATE), kind="ufo"),)},
            "malformed",
        ),
        ({"lanelets": (straight(1, -100, 100, float("nan")),)}, "lanelet 1"),
        ({"lanelets": (straight(1, 10, 10, 0.0),)}, "lanelet|distinct|off the road"),
        (
            {"problems": ('<planningProblem id="x"/>',)},
            "planningProblem has the id 'x'",
        ),
        (
            {"initial": "<initialState><time/><position/><orientation/><velocity/></initialState>"},
            "without a value",
        ),
    ],
)
def test_bad_content(write: Write, parts: dict[str, object], what: str) -> None:
    text = message(write(**parts))
    assert any(part in text for part in what.split("|")), text


def test_unknown_planning_problem(write: Write) -> None:
    assert "no planning problem 7; choose from 900" in message(write(), planning_problem=7)


# A group within which a field's length leads into the noughts, which then are fields of their own.
DEEP = b"\x0b\x12" + b"\xa0\x8d\x06" + bytes(99_998)


@pytest.mark.parametrize(
    ("name", "head"),
    [("n.xml", b"\x00\x01"), ("n.xml", b"<"), ("n.pb", b""), ("n.pb", b"\x0a"), ("n.pb", DEEP)],
)
def test_200_mb_of_noise_are_refused_at_once(tmp_path: Path, name: str, head: bytes) -> None:
    path = tmp_path / name
    with path.open("wb") as file:
        file.write(head + b"\x0b" + os.urandom(100_000))
        file.truncate(200_000_000)
    begin = time.process_time()
    message(path)
    assert time.process_time() - begin < 2.0


def test_protobuf_that_cannot_be_read(tmp_path: Path) -> None:
    for content in (b"\xff" * 50, b"\n\x05hello", os.urandom(300)):
        path = tmp_path / "x-SC.pb"
        path.write_bytes(content)
        message(path)


def test_nothing_is_printed_and_logging_is_left_alone(
    write: Write, capfd: pytest.CaptureFixture[str]
) -> None:
    level = logging.getLogger("commonroad").level
    intersection = (
        '<intersection id="70"><incoming id="71"><incomingLanelet ref="1"/>'
        '<successorsStraight ref="2"/></incoming></intersection>'
    )
    load(write(others=(intersection,), id="AUT_Test-1_1_T-1"))
    assert capfd.readouterr() == ("", "")
    assert logging.getLogger("commonroad").level == level


def test_parts_that_the_format_does_not_need(write: Write) -> None:
    """No scenario tags, an environment with a single value, a light without a cycle."""
    light = '<trafficLight id="60"/>'
    road = (straight(1, -100, 100, 0.0, lights=[60]),)
    header = (
        "<location><geoNameId>1</geoNameId><gpsLatitude>1</gpsLatitude>"
        "<gpsLongitude>1</gpsLongitude><environment><weather>fog</weather>"
        "</environment></location>"
    )
    scene = load(write(lanelets=road, others=(light,), header=header))
    assert (scene.weather, scene.time_of_day) == ("fog", None)
    assert [light.state for light in scene.lights] == ["unknown"]


def test_2018b_without_tags_and_environment_unknown(write: Write) -> None:
    road = tuple(part.replace("<laneletType>unknown</laneletType>", "") for part in ROAD)
    moving = car(7, state("initialState", 0, 20.0, 0.0, **STATE), state("state", 1, 21, 0, **STATE))
    moving = moving.replace("dynamicObstacle", "obstacle")
    moving = moving.replace("<type>", "<role>dynamic</role><type>")
    scene = load(write(version="2018b", header="", lanelets=road, obstacles=(moving,)))
    assert (scene.weather, scene.country) == (None, "DEU")
    assert scene.obstacles[0].states is not None
    assert scene.obstacles[0].states[:, 0].tolist() == [20.0, 21.0]


def test_protobuf_holds_the_same_scene(tmp_path: Path, write: Write) -> None:
    from commonroad.common.file_reader import CommonRoadFileReader
    from commonroad.common.writer.file_writer_interface import OverwriteExistingFile
    from commonroad.common.writer.file_writer_protobuf import ProtobufFileWriter

    moving = car(
        7,
        state("initialState", 0, 20.0, 0.0, **STATE),
        state("state", 1, 21.0, 0.0, **STATE),
    )
    expected = load(path := write(obstacles=(moving,)))
    scenario, problems = CommonRoadFileReader(filename_2020a=path).open()
    writer = ProtobufFileWriter(scenario, problems, "a", "b", "c", scenario.tags, 4)
    for part, name in (
        ("map", "DEU_Test-1.pb"),
        ("dynamic", "DEU_Test-1_1_T-1.pb"),
        ("scenario", "DEU_Test-1_1_T-1-SC.pb"),
    ):
        getattr(writer, f"write_{part}_to_file")(str(tmp_path / name), OverwriteExistingFile.ALWAYS)
    scene = load(tmp_path / "DEU_Test-1_1_T-1-SC.pb")
    assert scene.ego == expected.ego
    assert [lane.lanelets for lane in scene.lanes] == [lane.lanelets for lane in expected.lanes]
    assert scene.obstacles[0].states is not None
    assert scene.obstacles[0].states[:, :2].tolist() == [[20.0, 0.0], [21.0, 0.0]]
    (tmp_path / "DEU_Test-1.pb").unlink()
    assert "DEU_Test-1.pb is missing" in message(tmp_path / "DEU_Test-1_1_T-1-SC.pb")
