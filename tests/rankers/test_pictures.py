"""Pictures on their way: the real client against a real server, which looks at what arrives."""

from __future__ import annotations

import base64
import io
import math
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from PIL import Image

import sandra
from chat_server import chat_server
from hostile_server import body, error
from sandra.describe import Prompt, PromptOptions, answered, describe, narrow
from sandra.rankers import Failure, create
from sandra.scene.types import Scene
from slow_server import Pace, SlowServer, slow_server
from straight_road import Road

BLUE, GREY = (0, 87, 194), (110, 110, 110)


@pytest.fixture
def server(no_openai_key: None) -> Iterator[SlowServer]:
    with slow_server(Pace()) as server:
        yield server


def scene(angle: float = 0.9) -> Scene:
    road = Road(angle, 12.0, -30.0)
    return road.scene(road.obstacle(5, 40.0, 0.0, 0.0), lanes=road.three_lanes())


def prompt(up: str | None = "ego", angle: float = 0.9) -> Prompt:
    return describe(scene(angle), "drive faster", options=PromptOptions(picture=up))


def messages(server: SlowServer, request: int = 0) -> list[dict[str, Any]]:
    found: list[dict[str, Any]] = server.requests[request].body["messages"]
    return found


def look(message: dict[str, Any]) -> np.ndarray:
    """The pixels of a user's message, whose form is checked as the API documents it."""
    text, image = message["content"]
    assert set(text) == {"type", "text"}
    assert text["type"] == "text"
    assert image == {"type": "image_url", "image_url": {"url": image["image_url"]["url"]}}
    kind, _, data = image["image_url"]["url"].partition(",")
    assert kind == "data:image/png;base64"
    picture = Image.open(io.BytesIO(base64.b64decode(data, validate=True)))
    picture.verify()
    picture = Image.open(io.BytesIO(base64.b64decode(data)))
    assert (picture.format, picture.size) == ("PNG", (512, 512))
    return np.asarray(picture.convert("RGB"))


def centre(image: np.ndarray, colour: tuple[int, int, int]) -> np.ndarray:
    rows, columns = np.nonzero((image == colour).all(axis=2))
    assert len(rows)
    return np.array([columns.mean(), rows.mean()])


@pytest.mark.parametrize("angle", [0.0, 0.9, -2.4])
def test_a_model_sees_what_is_ahead_above_the_ego(server: SlowServer, angle: float) -> None:
    asked = prompt("ego", angle)
    ranking = create("openai:vision", base_url=server.url).rank(asked, 5.0)
    assert ranking.failure is None
    assert len(ranking.pairs) == 3
    system, user = messages(server)
    assert system == {"role": "system", "content": asked.system}
    assert user["content"][0]["text"] == asked.user
    image = look(user)
    way = centre(image, BLUE) - centre(image, GREY)
    assert way == pytest.approx([0.0, 200.0], abs=1.5)


def test_north_stays_north(server: SlowServer) -> None:
    create("openai:vision", base_url=server.url).rank(prompt("north", 0.9), 5.0)
    image = look(messages(server)[1])
    way = centre(image, GREY) - centre(image, BLUE)
    assert way == pytest.approx([200.0 * math.cos(0.9), -200.0 * math.sin(0.9)], abs=2.0)


def test_without_the_option_the_content_is_text(server: SlowServer) -> None:
    asked = prompt(None)
    create("openai:text", base_url=server.url).rank(asked, 5.0)
    assert messages(server)[1] == {"role": "user", "content": asked.user}


def test_verify_first_shows_it_once_and_begins_both_turns_alike(server: SlowServer) -> None:
    asked = prompt("ego")
    ahead = create("openai:vision", base_url=server.url).begin(asked, 5.0)  # type: ignore[attr-defined]
    hold = [pair for pair in asked.feasible if pair.lateral.value == "follow-lane"]
    ranking = ahead.finish(narrow(asked, hold))
    assert ranking.failure is None
    first, second = messages(server, 0), messages(server, 1)
    assert second[:2] == first
    look(first[1])
    assert [type(m["content"]) for m in second] == [str, list, str, str]


def test_a_whole_decision_with_a_picture(server: SlowServer) -> None:
    decision = sandra.decide(
        sandra.load(sandra.example("merge")),
        "openai:vision",
        base_url=server.url,
        horizon=8,
        accept="reachable",
        prompt_options=PromptOptions(picture="ego"),
    )
    assert decision.ranking.pairs
    assert not decision.ranking.warnings
    image = look(messages(server)[1])
    assert centre(image, BLUE) == pytest.approx([255.5, 383.5], abs=1.0)


def test_the_responses_api_has_other_names_for_the_parts() -> None:
    # What its documentation gives for a message with a picture.
    with chat_server(body({"output": []})) as server:
        create("openai:vision#api=responses", base_url=server.url).rank(prompt("ego"), 5.0)
    system, user = server.requests[0]["input"]
    assert isinstance(system["content"], str)
    text, image = user["content"]
    assert text == {"type": "input_text", "text": prompt("ego").user}
    assert image == {"type": "input_image", "image_url": prompt("ego").picture.data_url}  # type: ignore[union-attr]


@pytest.mark.parametrize("status", [400, 404, 500])
def test_a_model_without_eyes_is_a_named_failure(status: int) -> None:
    with chat_server(error(status, "image input is not supported")) as server:
        decision = sandra.decide(
            scene(),
            "openai:blind",
            base_url=server.url,
            horizon=6,
            accept="reachable",
            prompt_options=PromptOptions(picture="ego"),
        )
    expected = Failure.SERVER_ERROR if status == 500 else Failure.REJECTED
    assert decision.ranking.failure is expected
    assert "image input is not supported" in (decision.ranking.detail or "")
    assert decision.maneuver.kind == "fail-safe"
    # It is not asked anything else.
    assert all(isinstance(r["messages"][1]["content"], list) for r in server.requests)


def test_a_repaired_ranking_sees_the_picture_again() -> None:
    question = prompt("ego")
    again = answered(question, {}, unusable="it was no JSON")
    assert again.picture == question.picture


class Looks:
    """A ranker of the user's that looks at the picture."""

    name = "looks"
    takes_pictures = True
    seen: bytes | None = None

    def rank(self, prompt: Prompt, deadline: float | None = None) -> list[sandra.ActionPair]:
        Looks.seen = None if prompt.picture is None else prompt.picture.png
        return list(prompt.feasible[: prompt.k])


@pytest.mark.parametrize(
    ("ranker", "looks"), [("rules", False), ("random:1", False), (Looks(), True)]
)
def test_who_does_not_look_says_so(ranker: Any, looks: bool) -> None:
    def decide(up: str | None) -> sandra.Decision:
        return sandra.decide(
            scene(), ranker, horizon=6, accept="reachable", prompt_options=PromptOptions(picture=up)
        )

    warnings = decide("ego").ranking.warnings
    assert any("the picture was not looked at" in words for words in warnings) is not looks
    assert decide(None).ranking.warnings == ()
    if looks:
        decide("ego")
        assert Looks.seen == prompt("ego").picture.png  # type: ignore[union-attr]
