"""The options about the prompt, on the command line and in a run."""

from __future__ import annotations

import base64
import json
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import pytest

from loopback import serving
from sandra.cli import main
from sandra.describe import Beams, PromptOptions, Templates
from sandra.evaluation.closed_loop.drive import Drive
from scene_xml import Scenario

HERE = (
    "<location><geoNameId>1</geoNameId><gpsLatitude>48.1</gpsLatitude>"
    "<gpsLongitude>11.6</gpsLongitude></location><scenarioTags/>"
)
KEY = "5ecre7"


class Sky(BaseHTTPRequestHandler):
    """Heavy rain for whoever has the key."""

    def do_GET(self) -> None:
        known = f"appid={KEY}" in self.path
        self.send_response(200 if known else 401)
        self.end_headers()
        self.wfile.write(json.dumps({"weather": [{"id": 502}]} if known else {}).encode())

    def log_message(self, *args: object) -> None:
        """Silent."""


@pytest.fixture
def sky(monkeypatch: pytest.MonkeyPatch) -> Iterator[ThreadingHTTPServer]:
    server = ThreadingHTTPServer(("127.0.0.1", 0), Sky)
    monkeypatch.setenv("OPENWEATHERMAP_BASE_URL", f"http://127.0.0.1:{server.server_port}")
    monkeypatch.setenv("OPENWEATHERMAP_API_KEY", KEY)
    with serving(server):
        yield server


@pytest.fixture
def scenario(tmp_path: Path) -> str:
    file = tmp_path / "here.xml"
    file.write_text(Scenario(header=HERE).xml(), encoding="utf-8")
    return str(file)


def test_prompt_shows_all_of_it(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    picture, mine = tmp_path / "look.png", tmp_path / "mine.toml"
    mine.write_text('[system]\ntask = "Drive!"\n', encoding="utf-8")
    words = ["--vision", "north", "--picture", str(picture), "--measures", "all"]
    words += ["--weather", "light rain", "--obstacles", "beams:720,80", "--templates", str(mine)]
    assert main(["prompt", "intersection", *words]) == 0
    out = capsys.readouterr().out
    for told in ("Drive!", "up is north", "brake threat number is", "light rain", "that you see"):
        assert told in out
    assert "picture about 256; 3.6 characters each)" in out
    assert f"picture: {picture}" in out
    assert picture.read_bytes().startswith(b"\x89PNG")
    assert main(["prompt", "intersection", *words, "--json"]) == 0
    data = json.loads(capsys.readouterr().out)
    assert base64.b64decode(data["picture"].partition(",")[2]) == picture.read_bytes()
    assert data["tokens"]["picture"] == 256


def test_decide_takes_the_same(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    picture = tmp_path / "look.png"
    words = ["--vision", "ego", "--picture", str(picture), "--accept", "reachable"]
    assert main(["decide", "merge", *words, "--horizon", "6"]) == 0
    out = capsys.readouterr().out
    assert "ranking: the picture was not looked at: embedded reads no pictures" in out
    assert "tokens (text " in out
    assert f"picture of the prompt: {picture}" in out
    assert picture.exists()


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--vision", "south"], "picture 'south': choose from ego, north"),
        (["--picture", "look.png"], "add --vision"),
        (["--measures", "luck"], "measure 'luck': choose from time-headway"),
        (["--obstacles", "radar"], "obstacles 'radar': write lanes, beams"),
        (["--templates", "nowhere.toml"], "nowhere.toml: cannot be read"),
    ],
)
def test_what_cannot_be(words: list[str], message: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["prompt", "merge", *words]) == 2
    told = capsys.readouterr().err
    assert message in told
    assert len(told.splitlines()) == 1


def test_list_templates_is_a_file_for_templates(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as stop:
        main(["prompt", "--list-templates"])
    assert stop.value.code == 0
    file = tmp_path / "ours.toml"
    file.write_text(capsys.readouterr().out, encoding="utf-8")
    assert Templates.load(file).tables == Templates().tables


def test_weather_is_looked_up(
    sky: object, scenario: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["prompt", scenario, "--weather", "openweathermap"]) == 0
    told = capsys.readouterr()
    assert "with heavy rain" in told.out
    assert told.err == ""


def test_weather_that_cannot_be_looked_up_is_unknown(
    sky: object,
    scenario: str,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setenv("OPENWEATHERMAP_API_KEY", "wr0ng")
    assert main(["prompt", scenario, "--weather", "openweathermap"]) == 0
    told = capsys.readouterr()
    assert told.err == "warning: unknown weather: the server answered HTTP 401; check the key\n"
    assert "wr0ng" not in told.out + told.err
    assert "of unknown type.\n" in told.out
    # The scenarios that are shipped are nowhere on earth; what their files say is not told either.
    assert main(["prompt", "merge", "--weather", "openweathermap"]) == 0
    told = capsys.readouterr()
    assert told.err == "warning: unknown weather: the scenario gives no coordinates\n"
    assert "cloudy" not in told.out


def test_weather_without_a_key(
    scenario: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.delenv("OPENWEATHERMAP_API_KEY", raising=False)
    assert main(["prompt", scenario, "--weather", "openweathermap"]) == 2
    assert "set OPENWEATHERMAP_API_KEY" in capsys.readouterr().err


def test_a_simulation_is_nowhere(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["drive", "--weather", "openweathermap"]) == 2
    assert "--weather rain" in capsys.readouterr().err


def test_options_are_written_into_a_run_and_compared() -> None:
    options = PromptOptions(
        picture="ego",
        measures=("brake-threat",),
        beams=Beams(90, 50.0),
        weather="rain",
        templates=Templates((("system", "task", "Drive!"),)),
    )
    mine = Drive(prompt_options=options)
    written = json.loads(json.dumps(mine.to_dict()["prompt_options"]))
    assert written["templates"]["changes"] == [["system", "task", "Drive!"]]
    assert mine.differs(mine.to_dict()) == []
    assert mine.differs(Drive().to_dict()) == ["prompt_options"]
    # A run folder from before there were options.
    older = {k: v for k, v in Drive().to_dict().items() if k != "prompt_options"}
    assert Drive().differs(older) == []


@pytest.mark.slow
def test_a_run_keeps_the_pictures(tmp_path: Path) -> None:
    words = ["--steps", "2", "--vision", "ego", "--weather", "rain", "--out", str(tmp_path / "run")]
    assert main(["drive", "highway", *words]) == 0
    folder = tmp_path / "run" / "seed-5838"
    assert len(list((folder / "pictures").glob("step-*.png"))) == 2
    line = json.loads((folder / "decisions.jsonl").read_text().splitlines()[0])
    assert "with rain" in line["prompt"]["user"]
