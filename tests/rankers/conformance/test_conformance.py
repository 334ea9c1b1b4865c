"""What every ranker keeps to, whoever it is: one protocol, one test-suite.

Language models are real ones here: a tiny model that is made in the test run (`tiny_model`), in
this process and behind a real llama.cpp server on loopback, asked by the real `openai` client.
"""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path

import pytest

import sandra
from sandra.cli import main
from sandra.decider import Decider
from sandra.decision import MODES
from sandra.describe import Prompt, PromptOptions, describe, narrow
from sandra.rankers import CHOICES, Failure, Ranker, Ranking, ask, create
from straight_road import Road

ROAD = Road()
SCENE = ROAD.scene(ROAD.obstacle(7, 60.0, 0.0, 8.0), lanes=ROAD.three_lanes())
ONE_LANE = ROAD.scene(ROAD.obstacle(7, 60.0, 0.0, 8.0))
PROMPT = describe(SCENE, "drive faster")
LONG = replace(PROMPT, user=(PROMPT.user + "\n") * 8)
PLUG_IN = """
from sandra.actions import ActionPair

def conform(prompt):
    return sorted(prompt.feasible, key=str)[: prompt.k]
"""
RECORDING = {
    "scenario": SCENE.name,
    "ranking": [{"longitudinal": "keep", "lateral": "follow-lane"}],
}


@dataclass(frozen=True)
class Backend:
    """A spec with `{tiny}`, `{here}` for folders; what may be expected of who is made of it."""

    spec: str
    served: bool = False
    """Asks the server on loopback."""
    answers: bool = True
    """With a ranking, and no failure, where it is given time."""
    thinks: bool = False
    """A language model: it may need longer than a deadline allows."""
    exact: bool = False
    """With as many pairs as were asked for, none of them twice."""
    most: int | None = None
    """Pairs at most, where that is not the prompt's k."""
    blind: bool = False
    """Looks at no pictures, though its server may."""


LLAMA = "#temperature=0"
BACKENDS = {
    "openai": Backend("openai:tiny" + LLAMA, served=True, thinks=True),
    # This server's /responses ignores the schema (llama.cpp): a failure may be named.
    "responses": Backend(
        "openai:tiny#api=responses&temperature=0", served=True, thinks=True, answers=False
    ),
    "ollama": Backend("ollama:tiny" + LLAMA, served=True, thinks=True),
    "vllm": Backend("vllm:tiny" + LLAMA, served=True, thinks=True),
    "gguf": Backend("gguf:{tiny}/model.gguf#threads=1", thinks=True, exact=True),
    "hf": Backend("hf:{tiny}/model#device=cpu", thinks=True, exact=True),
    "hf-adapter": Backend("hf:{tiny}/model+{tiny}/adapter#device=cpu", thinks=True, exact=True),
    "hf-score": Backend("hf:{tiny}/model#mode=score&device=cpu", thinks=True, exact=True),
    "hf-score-adapter": Backend(
        "hf:{tiny}/model+{tiny}/adapter#mode=score&device=cpu", thinks=True, exact=True
    ),
    # The tiny model never learned to end with a number: what comes is a named failure.
    "dilu": Backend(
        "dilu:tiny#shots=1", served=True, thinks=True, answers=False, most=1, blind=True
    ),
    "embedded": Backend("embedded", thinks=True, exact=True),
    "rules": Backend("rules"),
    "exhaustive": Backend("exhaustive", most=12),
    "random": Backend("random:3"),
    "adversarial": Backend("adversarial"),
    "replay": Backend("replay:{here}/recording.jsonl", answers=False),
    "always": Backend("always:stop,follow-lane", answers=False),
    "garbage": Backend("garbage", answers=False),
    "late": Backend("late:0.05", answers=False),
    "plug-in": Backend("sandra_conforming:conform"),
}
MODELS = [name for name, backend in BACKENDS.items() if backend.thinks]
every = pytest.mark.parametrize("name", BACKENDS)
every_model = pytest.mark.parametrize("name", MODELS)


@dataclass(frozen=True)
class Made:
    spec: str
    ranker: Ranker
    backend: Backend
    base_url: str | None


Maker = Callable[[str], Made]


@pytest.fixture(scope="module")
def here(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    folder = tmp_path_factory.mktemp("conformance")
    (folder / "recording.jsonl").write_text(json.dumps(RECORDING), encoding="utf-8")
    (folder / "sandra_conforming.py").write_text(PLUG_IN, encoding="utf-8")
    sys.path.insert(0, str(folder))
    yield folder
    sys.path.remove(str(folder))


@pytest.fixture
def make(here: Path, request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> Maker:
    for server in ("OPENAI", "OLLAMA", "VLLM"):
        for variable in ("API_KEY", "BASE_URL"):
            monkeypatch.delenv(f"{server}_{variable}", raising=False)

    def made(name: str) -> Made:
        backend = BACKENDS[name]
        tiny = request.getfixturevalue("tiny") if backend.thinks else here
        url = request.getfixturevalue("llama_server") if backend.served else None
        spec = backend.spec.replace("{tiny}", str(tiny)).replace("{here}", str(here))
        return Made(spec, create(spec, base_url=url), backend, url)

    return made


def keeps_to(ranking: Ranking, prompt: Prompt, made: Made) -> None:
    """The promises of `Ranking`."""
    assert ranking.ranker == made.ranker.name
    assert len(set(ranking.pairs)) == len(ranking.pairs) <= (made.backend.most or prompt.k)
    assert set(ranking.pairs) <= set(prompt.feasible)
    assert (ranking.detail is None) == (ranking.failure is None)
    assert ranking.failure is not None or ranking.pairs
    assert "\n" not in (ranking.detail or "")
    if made.backend.answers:
        assert ranking.failure is None, ranking
    if made.backend.exact:
        assert len(ranking.pairs) == prompt.k
        assert ranking.warnings == ()


@every
def test_it_is_a_ranker_with_the_name_of_its_spec(make: Maker, name: str) -> None:
    made = make(name)
    assert isinstance(made.ranker, Ranker)
    if not made.spec.startswith("replay"):  # named by its file
        assert made.ranker.name == made.spec
    kind = made.spec.partition(":")[0]
    assert kind in CHOICES or kind == "sandra_conforming"


@every
def test_distinct_feasible_pairs_at_most_k_or_a_named_failure(make: Maker, name: str) -> None:
    made = make(name)
    pair = PROMPT.feasible[-1]
    one_pair = narrow(PROMPT, [pair])
    for prompt in (
        PROMPT,
        describe(SCENE, settings=sandra.Settings(k=1)),
        describe(ONE_LANE, "stop at once", [pair]),
        one_pair,
        replace(PROMPT, system="", user=""),
        replace(PROMPT, user="\x00\ufffd {{ m }} <|im_end|> \U0001f697 " + PROMPT.user),
    ):
        ranking = made.ranker.rank(prompt, 30.0)
        keeps_to(ranking, prompt, made)
        if prompt is one_pair and made.backend.answers:
            assert ranking.pairs == (pair,)


@every_model
def test_a_prompt_with_a_picture_is_answered_whether_it_is_looked_at_or_not(
    make: Maker, name: str
) -> None:
    made = make(name)
    prompt = describe(SCENE, options=PromptOptions(picture="ego"))
    assert prompt.picture is not None
    looks = getattr(made.ranker, "takes_pictures", False)
    decision = sandra.decide(
        ONE_LANE, made.ranker, horizon=6, prompt_options=PromptOptions(picture="ego")
    )
    told = any("picture" in warning for warning in decision.ranking.warnings)
    if made.backend.served and not made.backend.blind:
        assert looks  # what the server makes of it is told as a failure, if it can make nothing
    else:
        assert not looks
        assert told
        keeps_to(made.ranker.rank(prompt, 30.0), prompt, made)


@every_model
def test_the_deadline_holds_and_the_next_question_finds_the_model_free(
    make: Maker, name: str
) -> None:
    made = make(name)
    made.ranker.rank(PROMPT, 30.0)  # whatever is imported at first use
    deadline, took = 0.02, []
    for _ in range(3):
        begin = time.monotonic()
        ranking = made.ranker.rank(LONG, deadline)
        took.append(time.monotonic() - begin)
        assert ranking.failure is Failure.TIMEOUT, ranking
        assert len(set(ranking.pairs)) == len(ranking.pairs) <= LONG.k
    assert min(took) < deadline + 0.1  # a busy machine may be late itself
    keeps_to(made.ranker.rank(PROMPT, 30.0), PROMPT, made)


@every
def test_the_same_prompt_is_answered_the_same_way_also_by_several_at_once(
    make: Maker, name: str
) -> None:
    ranker = make(name).ranker
    first = ranker.rank(PROMPT, 30.0)
    ranker.rank(describe(ONE_LANE), 30.0)
    with ThreadPoolExecutor(3) as pool:
        others = list(pool.map(lambda _: ranker.rank(PROMPT, 30.0), range(3)))
    assert [r.pairs for r in others] == [first.pairs] * 3
    assert {r.failure for r in others} == {first.failure}


@pytest.mark.parametrize("mode", [mode for mode in MODES if mode != "exhaustive"])
@every
def test_every_mode_of_a_decision(make: Maker, name: str, mode: str) -> None:
    made = make(name)
    decision = sandra.decide(ONE_LANE, made.ranker, horizon=6, mode=mode)
    # After a second question (repair) the answer to the first one may still be the one that counts.
    asked = describe(ONE_LANE) if mode == "repair" else decision.prompt
    keeps_to(decision.ranking, asked, made)
    certified = [v.pair for v in decision.verdicts if v.status is sandra.Status.CERTIFIED]
    assert decision.maneuver.pair is None or decision.maneuver.pair in certified
    if made.backend.answers and mode == "verify-first":
        assert decision.maneuver.pair is not None
        assert set(decision.ranking.pairs) <= set(certified)


@every
def test_a_decider_and_the_command_line_take_its_spec(
    make: Maker, name: str, capsys: pytest.CaptureFixture[str]
) -> None:
    made = make(name)
    decider = Decider(made.spec, horizon=6, base_url=made.base_url)
    keeps_to(decider.decide(ONE_LANE).ranking, describe(ONE_LANE), made)
    url = ["--base-url", made.base_url] if made.base_url else []
    words = ["decide", "rural-oncoming", "--ranker", made.spec, *url, "--horizon", "6", "--json"]
    assert main(words) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["ranker"] == made.ranker.name
    assert told["ranking"] or told["failure"]
    assert not made.backend.answers or told["failure"] is None


def test_whoever_is_offered_is_tested() -> None:
    kinds = {word.strip().partition(":")[0].partition("[")[0] for word in CHOICES.split(",")}
    tested = {b.spec.partition(":")[0] for b in BACKENDS.values()} | {"or module"}
    assert kinds <= tested


def test_ask_takes_a_spec(tiny: Path) -> None:
    assert ask(f"gguf:{tiny}/model.gguf#threads=1", PROMPT).failure is None
