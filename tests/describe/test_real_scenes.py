import re
from pathlib import Path

import pytest

from sandra.describe import describe, render
from sandra.describe.facts import AHEAD, BEHIND
from sandra.scene import load

NAMES = (
    "DEU_AachenBendplatz-1_80_T-19",
    "DEU_Gar-1_1_T-1",
    "DEU_Goeppingen-37_1_T-4",
    "DEU_LocationALower-11_10_T-1",
    "ZAM_Sandra-5838_1_T-1001-set-no-rule",
)


@pytest.mark.parametrize("name", NAMES)
def test_the_prompt_of_a_recorded_scene_is_sound(shared: Path, name: str) -> None:
    scene = load(shared / f"data/scenarios/{name}.xml")
    prompt = describe(scene, "drive faster", rules=("R_G1", "R_G3"), rule_prompt=True)
    text = render(prompt)
    assert not re.search(r"\bnan\b|\binf\b|None|-0\.0+\b", text)
    assert len(prompt.user) < 8000
    ids = [o.id for o in prompt.situation.obstacles]
    assert len(ids) == len(set(ids))
    assert re.findall(r"^  - [a-z ]+ (\d+): ", prompt.user, re.MULTILINE) == [str(i) for i in ids]
    for o in prompt.situation.obstacles:
        assert -BEHIND <= o.gap <= AHEAD
        assert o.time_to_collision >= 0.0


def test_the_case_study_of_the_paper(shared: Path) -> None:
    scene = load(shared / "data/scenarios/DEU_Goeppingen-37_1_T-4.xml")
    prompt = describe(scene, "drive faster")
    assert [a.value for a in prompt.lateral] == ["follow-lane", "right-lane"]
    assert "Your velocity is 7.7 m/s" in prompt.user
    assert "acceleration is -2.1 m/s²." in prompt.user
    assert "traffic regulations" not in prompt.user
    leader = next(o for o in prompt.situation.obstacles if o.id == 20074)
    assert leader.relation == "same"
    closing = prompt.situation.speed - leader.speed
    assert leader.time_to_collision == pytest.approx(leader.gap / closing, rel=0.01)


def test_a_copy_of_a_car_in_the_file_is_told_once(shared: Path) -> None:
    scene = load(shared / "data/scenarios/DEU_Goeppingen-37_1_T-5.xml")
    assert {o.id for o in scene.obstacles} >= {20074, 85748}
    told = {o.id for o in describe(scene).situation.obstacles}
    assert len(told & {20074, 85748}) == 1
