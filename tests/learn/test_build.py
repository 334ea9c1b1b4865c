"""Rows of prompt and ranking: the prompt of the moment, what was driven first, nothing dropped."""

import json
import re
from collections import Counter
from dataclasses import replace

import numpy as np
import pytest

import sandra
from sandra.actions import ALL_PAIRS, ActionPair
from sandra.cli import main
from sandra.cli.dataset import bar
from sandra.describe import describe
from sandra.errors import SandraError, ScenarioError, SettingsError
from sandra.evaluation.dataset.build import AUTO, build
from sandra.evaluation.dataset.folder import DataFolder
from sandra.evaluation.journal import Journal
from sandra.learn.episodes import SPLITS, Recipe
from sandra.learn.export import answer, estimated_tokens, example
from sandra.learn.record import play, save
from sandra.learn.rows import Row, read_rows
from sandra.learn.variety import LATERAL_WISHES, LONGITUDINAL_WISHES, OTHER_WISHES, drawn
from sandra.learn.windows import Windows, ranking, rows_of, split_of_file
from sandra.rankers.answer import parse_answer
from sandra.scene.tracks import Tracks
from sandra.scene.writing import write
from sandra.settings import Settings

HORIZON = 5
HOW = Windows(per_vehicle=2, vehicles=4, settings=Settings(horizon=HORIZON))


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """Five episodes, in one of them all crash, and two files that are no recordings."""
    folder = tmp_path_factory.mktemp("recorded")
    recipe = Recipe(
        environments=("roundabout", "merge"),
        densities=(0.5, 0.75),
        drivers=("mixed",),
        duration=1.6,
        warm_up=1.0,
        seed=6,
    )
    DataFolder(folder).record(recipe, 5)
    file = sorted(folder.glob("train/roundabout-*.xml"))[0]
    crashed = {str(track.id): 3 for track in Tracks(file).all()}
    file.with_suffix(".crashed.json").write_text(json.dumps(crashed))
    (folder / "train" / "nothing.xml").write_text("<nothing/>")
    (folder / "train" / "marked.xml").write_bytes(file.read_bytes())
    (folder / "train" / "marked.crashed.json").write_text("no JSON")
    return folder


@pytest.fixture(scope="module")
def built(recorded, tmp_path_factory):
    out = tmp_path_factory.mktemp("built") / "data.jsonl"
    build(recorded, out, HOW)
    return out


@pytest.fixture(scope="module")
def rows(built):
    return list(read_rows(built))


class Listener:
    """A ranker that keeps what it was asked."""

    name = "listener"

    def rank(self, prompt, deadline=None):
        self.prompt = prompt
        return sandra.Ranking(pairs=prompt.feasible[:1], ranker=self.name)


def test_the_prompt_of_a_row_is_what_a_ranker_is_asked(rows, recorded, tmp_path, capsys):
    """By `sandra.decide`, and by the command line with the scene of that moment as a file.

    A file tells no route at forks, so it is one of the merge, where there is none.
    """
    labelled = [row for row in rows if row.is_labelled]
    turning = [row for row in labelled if "steering angle is 0.000" not in row.user]
    listener = Listener()
    for row in (turning[0], turning[-1], labelled[0]):
        scene = Tracks(recorded / row.scenario).scene(row.ego, row.step)
        sandra.decide(scene, listener, horizon=HORIZON, accept="reachable")
        asked = listener.prompt
        assert (row.system, row.user, row.schema) == (asked.system, asked.user, asked.schema)
        assert row.feasible == tuple(map(str, asked.feasible))

    (tmp_path / "settings.toml").write_text(f"horizon = {HORIZON}\n")
    with_settings = ["--settings", str(tmp_path / "settings.toml"), "--json"]
    at_the_merge = [row for row in labelled if "/merge-" in row.scenario]
    for row in (at_the_merge[0], at_the_merge[-1]):
        scene = Tracks(recorded / row.scenario).scene(row.ego, row.step)
        file = write(scene, tmp_path / f"{row.ego}-{row.step}.xml")
        assert main(["prompt", str(file), *with_settings]) == 0
        told = json.loads(capsys.readouterr().out)
        assert (told["system"], told["user"], told["schema"]) == (row.system, row.user, row.schema)


@pytest.mark.parametrize("environment", ["highway", "merge"])
def test_a_prompt_tells_nothing_of_what_comes(environment, tmp_path):
    """Of a recording that ends soon and of one that goes on, the prompts of a step are the same.

    At forks they may differ: there, the end of the recording tells the route.
    """
    episode = Recipe(environments=(environment,), densities=(0.5,)).episode(3)
    files = [tmp_path / "short.xml", tmp_path / "long.xml"]
    for file, steps in zip(files, (3, 25), strict=True):
        save(episode, play(episode, steps, 5), file)
    short, long = map(Tracks, files)
    changes = same = 0
    for track in long.all():
        try:
            scenes = [tracks.scene(track.id, 3) for tracks in (short, long)]
        except ScenarioError:
            continue  # It is off the road, or was not there yet.
        texts = [describe(scene) for scene in scenes]
        assert (texts[0].user, texts[0].system) == (texts[1].user, texts[1].system)
        same += 1
        rows = scenes[1].recorded_ego
        changes += np.nanmax(np.abs(rows[:, 1] - rows[0, 1])) > 2.0
    assert same >= 5
    assert changes or environment == "highway"


def test_the_label_is_first_and_the_rest_is_feasible_and_distinct(rows):
    labelled = [row for row in rows if row.is_labelled]
    assert len(labelled) >= 20
    for row in labelled:
        assert row.ranking[0] == row.label
        assert len(set(row.ranking)) == len(row.ranking) == 3
        assert set(row.ranking) <= set(row.feasible)
    # Not always the same order after the label.
    assert len({row.ranking for row in labelled if row.label == labelled[0].label}) > 1


def test_the_order_after_the_label_is_uniform_and_seeded():
    first = ALL_PAIRS[4]
    orders = [ranking(first, ALL_PAIRS, np.random.default_rng(i)) for i in range(600)]
    assert all(sorted(map(str, order)) == sorted(map(str, ALL_PAIRS)) for order in orders)
    assert all(order[0] == first for order in orders)
    second = Counter(order[1] for order in orders)
    assert len(second) == 11
    assert max(second.values()) < 2 * min(second.values())
    assert orders[7] == ranking(first, ALL_PAIRS, np.random.default_rng(7))


def test_nothing_is_dropped(rows, recorded):
    """Each file, each vehicle, each window has its row, with a label or with the reason why not."""
    files = {str(file.relative_to(recorded)) for file in recorded.rglob("*.xml")}
    assert {row.scenario for row in rows} == files
    for name in files - {"train/nothing.xml", "train/marked.xml"}:
        tracks = Tracks(recorded / name).all()
        here = [row for row in rows if row.scenario == name]
        assert len({row.ego for row in here}) == min(len(tracks), HOW.vehicles)
        for track in tracks:
            if track.id not in {row.ego for row in here}:
                continue
            starts = track.windows(HORIZON, 1)
            windows = len(starts[1:] or starts)
            assert sum(row.ego == track.id for row in here) == min(max(windows, 1), 2)
    assert all(row.detail for row in rows if not row.is_labelled)
    broken = {row.scenario: row for row in rows if row.status == "error"}
    assert {"train/nothing.xml", "train/marked.xml"} <= set(broken)
    assert "CommonRoad" in broken["train/nothing.xml"].detail
    assert "mend it" in broken["train/marked.xml"].detail
    crashed = [row for row in rows if row.status == "crashed"]
    assert crashed
    assert all(row.label is None and row.system is None for row in crashed)


def test_the_card_counts_what_is_in_the_file(rows, built):
    card = json.loads(built.with_suffix(".card.json").read_text())
    statuses = Counter(row.status for row in rows)
    assert {k: sum(v.values()) for k, v in card["tables"]["rows by status"].items()} == statuses
    labels = Counter((row.label, row.split) for row in rows if row.is_labelled)
    told = {
        (label, split): n
        for label, counts in card["tables"]["labels"].items()
        for split, n in counts.items()
        if n
    }
    assert told == labels
    assert card["labelled rows"] == statuses["labelled"]
    assert card["rows without a label"] == len(rows) - statuses["labelled"]
    assert "| labelled rows |" in built.with_suffix(".card.md").read_text()


def test_an_interrupted_build_goes_on_and_ends_the_same(recorded, built, tmp_path, monkeypatch):
    from sandra.evaluation.dataset import build as module

    out = tmp_path / "data.jsonl"
    seen = []

    def until_the_fourth(job):
        seen.append(job[1])
        if len(seen) == 4:
            raise KeyboardInterrupt
        return real(job)

    real = module._one
    monkeypatch.setattr(module, "_one", until_the_fourth)
    with pytest.raises(KeyboardInterrupt):
        build(recorded, out, HOW)
    draft = out.with_name("data.jsonl.draft")
    with draft.open("a") as file:
        file.write('{"status": "labelled", "spl')  # cut short
    assert not out.exists()
    build(recorded, out, HOW)
    assert len(seen) == len(set(seen)) + 1  # only the interrupted one twice
    assert out.read_bytes() == built.read_bytes()
    assert not draft.exists()


def test_a_draft_of_another_build_is_not_gone_on_with(recorded, tmp_path):
    out = tmp_path / "data.jsonl"
    draft = out.with_name("data.jsonl.draft")
    about = {"folder": str(recorded.resolve()), **HOW.to_dict()}
    Journal(draft, about).add("train/nothing.xml", [])
    with pytest.raises(SandraError, match=r"differs in vehicles; .*remove it"):
        build(recorded, out, replace(HOW, vehicles=1))
    draft.unlink()
    build(recorded, out, replace(HOW, vehicles=1, per_vehicle=1))
    assert any(row.scenario == "train/nothing.xml" for row in read_rows(out))


def test_balancing_limits_frequent_labels_and_keeps_all_else(recorded, rows, tmp_path):
    for balance in (2, AUTO):
        out = tmp_path / f"{balance}.jsonl"
        built = build(recorded, out, HOW, balance)
        kept = list(read_rows(out))
        everything = {row.line() for row in rows}
        assert {row.line() for row in kept} <= everything
        assert [r.line() for r in kept if not r.is_labelled] == [
            r.line() for r in rows if not r.is_labelled
        ]
        before = Counter((r.label, r.split) for r in rows if r.is_labelled)
        after = Counter((r.label, r.split) for r in kept if r.is_labelled)
        for split in SPLITS:
            counts = sorted(n for (_, where), n in before.items() if where == split)
            limit = balance or counts[(len(counts) - 1) // 2]
            for key, n in before.items():
                if key[1] == split:
                    assert after[key] == min(n, limit)
        assert built.card.facts["left out by balancing"] == before.total() - after.total() > 0


def test_splits_of_other_folders_depend_on_the_name_alone():
    names = [f"highd/DEU_LocationA-{i}_1_T-1.xml" for i in range(1000)]
    splits = [split_of_file(name) for name in names]
    assert splits == [split_of_file(f"elsewhere/{name.split('/')[1]}") for name in names]
    counts = Counter(splits)
    assert 700 < counts["train"] < 900
    assert min(counts["validation"], counts["test"]) > 50
    assert split_of_file("a/test/b.xml") == "test"


def test_the_exported_answer_is_read_back_as_the_ranking(rows, recorded):
    """By the reader of models' answers; and it fits the schema that models are held to."""
    labelled = [row for row in rows if row.is_labelled]
    for row in labelled[::9]:
        scene = Tracks(recorded / row.scenario).scene(row.ego, row.step)
        prompt = describe(scene, settings=HOW.settings)
        read = parse_answer(answer(row), prompt, "tuned")
        assert read.failure is None
        assert read.warnings == ()
        assert tuple(map(str, read.pairs)) == row.ranking
        said = json.loads(answer(row))
        assert list(said) == row.schema["required"]
        listed = row.schema["properties"]["ranking"]
        assert len(said["ranking"]) == listed["minItems"] == listed["maxItems"]
        for pair in said["ranking"]:
            assert str(ActionPair.of(**pair)) in row.feasible


def test_openai_format(rows):
    """The checks of https://cookbook.openai.com/examples/chat_finetuning_data_prep, and the types
    of messages in OpenAI's own library."""
    from openai.types.chat import ChatCompletionMessageParam
    from pydantic import TypeAdapter

    row = next(row for row in rows if row.is_labelled)
    one = json.loads(json.dumps(example(row, "openai")))
    assert set(one) == {"messages"}
    assert [message["role"] for message in one["messages"]] == ["system", "user", "assistant"]
    assert all(set(message) == {"role", "content"} for message in one["messages"])
    assert all(isinstance(m["content"], str) and m["content"] for m in one["messages"])
    assert one["messages"][1]["content"] == row.user
    TypeAdapter(list[ChatCompletionMessageParam]).validate_python(one["messages"])


def test_trl_format(rows):
    """https://huggingface.co/docs/trl/dataset_formats: conversational prompt and completion."""
    row = next(row for row in rows if row.is_labelled)
    one = json.loads(json.dumps(example(row, "trl")))
    assert [message["role"] for message in one["prompt"]] == ["system", "user"]
    assert [message["role"] for message in one["completion"]] == ["assistant"]
    assert one["completion"][0]["content"] == answer(row)
    assert one["chat_template_kwargs"] == {"enable_thinking": False}


@pytest.mark.parametrize("form", ["openai", "trl"])
def test_export_on_the_command_line(form, rows, built, tmp_path, capsys):
    out = tmp_path / "train.jsonl"
    arguments = ["dataset", "export", str(built), "--format", form, "--out", str(out), "--json"]
    assert main(arguments) == 0
    told = json.loads(capsys.readouterr().out)
    train = [row for row in rows if row.split == "train"]
    expected = [example(row, form) for row in train if row.is_labelled]
    assert [json.loads(line) for line in out.read_text().splitlines()] == expected
    assert told["examples"] == len(expected)
    assert sum(told["left_out"].values()) == len(train) - len(expected)
    sizes = [estimated_tokens(row) for row in train if row.is_labelled]
    assert (told["tokens"], told["longest"]) == (sum(sizes), max(sizes))


def test_small_exports_are_warned_of_and_empty_ones_refused(rows, tmp_path, capsys):
    few = tmp_path / "few.jsonl"
    labelled = [row for row in rows if row.is_labelled and row.split == "train"][:3]
    few.write_text("".join(row.line() for row in labelled))
    out = tmp_path / "out.jsonl"
    words = ["dataset", "export", str(few), "--format", "openai", "--out", str(out)]
    assert main(words) == 0
    assert "fewer than 10 examples" in capsys.readouterr().out
    assert main([*words[:-1], str(tmp_path / "none.jsonl"), "--split", "test"]) == 2
    assert "no labelled row in split 'test'" in capsys.readouterr().err
    assert sorted(file.name for file in tmp_path.iterdir()) == ["few.jsonl", "out.jsonl"]


@pytest.mark.parametrize(
    "line",
    ["no JSON", "[]", '{"status": "labelled"}', '{"status": "x", "split": "train"}', "\udcff"],
)
def test_a_line_that_is_no_row_is_named(line, tmp_path):
    file = tmp_path / "rows.jsonl"
    good = Row("short", "train", "a.xml", 1, None, detail="short").line()
    file.write_bytes(good.encode() + line.encode("utf-8", "surrogateescape") + b"\n")
    with pytest.raises(SandraError, match=re.escape(str(file))):
        list(read_rows(file))


def test_what_cannot_be_built_is_said(recorded, tmp_path, capsys):
    with pytest.raises(SettingsError, match="labeler 'best' is unknown"):
        Windows(labeler="best")
    with pytest.raises(SettingsError, match="at least 1"):
        Windows(per_vehicle=0)
    (tmp_path / "empty").mkdir()
    out = ["--out", str(tmp_path / "x.jsonl")]
    assert main(["dataset", "build", str(tmp_path / "empty"), *out]) == 2
    assert "no .xml file" in capsys.readouterr().err
    assert main(["dataset", "build", str(tmp_path / "missing"), *out]) == 2
    assert "no such folder" in capsys.readouterr().err
    (tmp_path / "file").touch()
    nowhere = ["--out", str(tmp_path / "file" / "x.jsonl")]
    assert main(["dataset", "build", str(recorded), *nowhere]) == 2
    assert "cannot be written" in capsys.readouterr().err


@pytest.mark.parametrize("action", ["record", "build", "export"])
def test_each_action_has_an_example_in_its_help(action, capsys):
    with pytest.raises(SystemExit):
        main(["dataset", action, "--help"])
    assert f"example: sandra dataset {action} " in " ".join(capsys.readouterr().out.split())


def test_a_progress_bar_fills():
    assert [bar(n, 4, "x").count("#") for n in range(5)] == [0, 5, 10, 15, 20]
    assert bar(1, 4, "a.xml").endswith("1 of 4: a.xml")


def test_a_recording_as_long_as_a_window_has_one_row(tmp_path):
    """As pieces of real traffic may be: the window begins at the first step, the only one."""
    episode = Recipe(environments=("merge",), densities=(0.5,)).episode(3)
    save(episode, play(episode, HORIZON, 5), tmp_path / "piece.xml")
    rows = rows_of(tmp_path / "piece.xml", "piece.xml", HOW, {})
    assert {row.step for row in rows if row.status == "labelled"} == {0}
    longer = replace(HOW, settings=Settings(horizon=HORIZON + 1))
    assert {row.status for row in rows_of(tmp_path / "piece.xml", "piece.xml", longer, {})} == {
        "short"
    }


def test_variety_tells_what_a_recording_does_not_hold(recorded):
    """A wish, past pairs, the rules, a choice: in the share of prompts that is asked for; the label
    is never narrowed away, and the same row is told the same way again."""
    file = sorted(recorded.glob("train/*-0*.xml"))[1]
    name = f"train/{file.name}"
    plain = [r for r in rows_of(file, name, HOW, {}) if r.is_labelled]
    every = [r for r in rows_of(file, name, replace(HOW, variety=1.0), {}) if r.is_labelled]
    assert every == [r for r in rows_of(file, name, replace(HOW, variety=1.0), {}) if r.is_labelled]
    assert len(every) == len(plain) > 3
    for before, after in zip(plain, every, strict=True):
        assert after.label == before.label in after.feasible
        assert set(after.feasible) <= set(before.feasible)
        assert after.ranking[0] == after.label
        assert "The wish of your passenger is" in after.system
        assert "The past action pairs are" in after.system
        assert "R_G1" in after.user
        assert "only these hold here" in after.user
        assert "wish" not in before.system
        assert "R_G1" not in before.user


def test_a_wish_fits_what_was_driven_or_is_about_something_else():
    pair = ActionPair.parse("stop,left-lane")
    rng = np.random.default_rng(3)
    fitting = {
        *LONGITUDINAL_WISHES[pair.longitudinal],
        *LATERAL_WISHES[pair.lateral],
        *OTHER_WISHES,
    }
    told = Counter(drawn(0.5, pair, rng).command for _ in range(400))
    assert 150 < told.pop(None) < 250
    assert set(told) == fitting
    pasts = [drawn(0.5, pair, rng).past for _ in range(400)]
    assert {len(past) for past in pasts} == {0, 1, 2, 3, 4, 5}


def test_a_bare_prompt_tells_no_accelerations_and_no_road(recorded):
    file = sorted(recorded.glob("train/*-0*.xml"))[1]
    name = f"train/{file.name}"
    plain = [r for r in rows_of(file, name, HOW, {}) if r.is_labelled]
    every = [r for r in rows_of(file, name, replace(HOW, bare=1.0), {}) if r.is_labelled]
    assert [r.label for r in every] == [r.label for r in plain]
    said = re.compile(r"(?:acceleration|steering angle) is (-?[\d.]+)")
    assert len({float(x) for r in plain for x in said.findall(r.user)}) > 5
    assert {float(x) for r in every for x in said.findall(r.user)} == {0.0}
    for before, after in zip(plain, every, strict=True):
        assert "The speed limit here is" in before.user
        assert "No speed limit is known here." in after.user
        assert "on a road of unknown type" in after.user


@pytest.mark.parametrize("name", ["variety", "bare"])
def test_only_a_chance_is_one(name):
    with pytest.raises(SettingsError, match=f"{name} = 1.5: a chance, from 0 to 1"):
        Windows(**{name: 1.5})
