"""Sentences of a user's own, and what is said about files that do not fit."""

from pathlib import Path

import pytest

from sandra.actions import ActionPair
from sandra.describe import PromptOptions, Templates, describe, narrow
from sandra.describe.templates import ESSENTIAL, our_text, sentences
from sandra.errors import SettingsError
from straight_road import Road


def load(folder: Path, text: str) -> Templates:
    file = folder / "mine.toml"
    file.write_text(text, encoding="utf-8")
    return Templates.load(file)


def test_ours_laid_over_ours_change_nothing(tmp_path: Path) -> None:
    templates = load(tmp_path, our_text())
    scene = Road().scene(Road().obstacle(5, 24.5, 0.0, 4.0))
    mine = describe(scene, "hurry", options=PromptOptions(templates=templates))
    ours = describe(scene, "hurry")
    assert (mine.system, mine.user) == (ours.system, ours.user)
    assert templates.tables == sentences()


def test_some_sentences_of_my_own(tmp_path: Path) -> None:
    templates = load(
        tmp_path,
        """
[system]
task = "Du fährst ein Auto."
steps = ""

[ego]
state = "Tempo {speed:.0f} m/s."
""",
    )
    scene = Road().scene(Road().obstacle(5, 24.5, 0.0, 4.0))
    prompt = describe(scene, options=PromptOptions(templates=templates))
    assert prompt.system.startswith("Du fährst ein Auto.\n\nAn action pair")
    assert "\nTempo 10 m/s.\n" in prompt.user
    rest = [line for line in prompt.user.splitlines() if not line.startswith("Tempo")]
    ours = [x for x in describe(scene).user.splitlines() if not x.startswith("Your velocity")]
    assert rest == ours


def test_a_narrowed_prompt_speaks_the_same_language(tmp_path: Path) -> None:
    templates = load(
        tmp_path, '[narrowed]\nholds = "Es halten: {pairs}."\nrank = "Ordne {k} davon."\n'
    )
    prompt = describe(Road().scene(), options=PromptOptions(templates=templates))
    narrowed = narrow(prompt, [ActionPair.parse("keep,follow-lane")])
    assert narrowed.narrowing == "Es halten: keep,follow-lane. Ordne 1 davon."


def test_words_may_be_added_for_weather_and_countries(tmp_path: Path) -> None:
    templates = load(tmp_path, '[weather]\n"light rain" = "drizzling {{rain}}"\n')
    options = PromptOptions(weather="light_rain", templates=templates)
    assert "with drizzling {rain}." not in describe(Road().scene(), options=options).user
    templates = load(tmp_path, '[weather]\n"light rain" = "some drizzle"\n')
    options = PromptOptions(weather="light_rain", templates=templates)
    assert "with some drizzle." in describe(Road().scene(), options=options).user


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('[sytem]\ntask = "x"\n', r"mine.toml:1: unknown table 'sytem'; choose from system"),
        ('task = "x"\n', r"mine.toml: unknown table 'task'"),
        ("[system]\ntask = 3\n", r"mine.toml:2: system.task: must be a text in quotes"),
        ('[ego]\n\n# mine\nstat = "x"\n', r"mine.toml:4: ego.stat: no such sentence; choose"),
        (
            '[ego]\nroad = "{road}{conditions}"\nstate = "{sped:.1f} m/s"\n',
            r"mine.toml:3: ego.state: unknown placeholder {sped}; this sentence has {speed}",
        ),
        ('[system]\ntask = "{k}"\n', r"unknown placeholder {k}; this sentence has none"),
        (
            '[system]\ncommand = "hurry"\n',
            r"mine.toml:2: system.command: the placeholder {command}",
        ),
        ('[system]\nhorizon = "{seconds"\n', r"mine.toml:2: system.horizon: .*{{ and }}"),
        ('[ego]\nstate = "{speed:q}"\n', r"mine.toml:2: ego.state: .* cannot be filled in"),
        ('[ego]\nstate = "{speed.real}"\n', r"unknown placeholder {speed.real}"),
        ('[ego]\nstate = "{speed:{heading}}"\n', r"with a placeholder in it"),
        ('[ego]\nstate = "{speed:99999999999}"\n', r"more than three digits"),
        ('[weather]\nrain = "{weather}"\n', r"unknown placeholder {weather}"),
        ('[system]\ntask = "x\n', r"mine.toml: not a TOML file \(.*line 2"),
    ],
)
def test_what_does_not_fit(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(SettingsError, match=message):
        load(tmp_path, text)


def test_a_file_that_is_not_there(tmp_path: Path) -> None:
    with pytest.raises(SettingsError, match=r"cannot be read .*check the path"):
        Templates.load(tmp_path / "none.toml")


def test_what_is_essential_is_in_our_own_sentences() -> None:
    for (table, name), fields in ESSENTIAL.items():
        assert all(f"{{{field}" in sentences()[table][name] for field in fields)


def test_values_are_never_templates(tmp_path: Path) -> None:
    prompt = describe(Road().scene(), "{k} {0} {system}", options=PromptOptions(weather="{k}"))
    assert '"{k} {0} {system}"' in prompt.system
    assert "with {k}." in prompt.user
