"""What a verdict may claim, and how it is told."""

from dataclasses import dataclass

import pytest

from reach_scenes import Course, prediction
from sandra.actions import ALL_PAIRS, ActionPair
from sandra.logic import specification
from sandra.reach import Ground, ReachableSet, Status, Verdict, Verdicts, compute, ground
from sandra.settings import Settings

PAIR = ActionPair.parse("keep,follow-lane")


@dataclass(frozen=True)
class Answer:
    """A proof with any answer of a checker."""

    accepted: object


@pytest.fixture(scope="module")
def base() -> Ground:
    scene = Course().scene()
    return ground(scene, prediction(scene, 3), Settings(horizon=3))


def verdict(
    base: Ground,
    status: Status,
    empty: bool = False,
    reason: str | None = None,
    proof: object = None,
) -> Verdict:
    spec = specification(PAIR)
    found = ReachableSet((), 3, base.lattice) if empty else compute(base, spec)
    return Verdict(PAIR, status, spec, found, reason, 0.25, proof)


def test_only_an_accepted_proof_certifies(base: Ground) -> None:
    assert verdict(base, Status.CERTIFIED, proof=Answer(True)).proof == Answer(True)
    for answer in (False, None, 1, "yes"):
        with pytest.raises(ValueError, match="contradicts its certificate"):
            verdict(base, Status.CERTIFIED, proof=Answer(answer))
        # one that was refused may be kept with what is not certified
        assert verdict(base, Status.REACHABLE, proof=Answer(answer)).status is Status.REACHABLE
    for status, empty in ((Status.REACHABLE, False), (Status.UNSAFE, True)):
        with pytest.raises(ValueError, match="contradicts its certificate"):
            verdict(base, status, empty, proof=Answer(True))
        assert verdict(base, status, empty).proof is None


def test_every_status_needs_the_set_that_goes_with_it(base: Ground) -> None:
    for status, empty in (
        (Status.UNSAFE, False),
        (Status.REACHABLE, True),
        (Status.CERTIFIED, True),
    ):
        with pytest.raises(ValueError, match="contradicts its reachable set"):
            verdict(base, status, empty, proof=Answer(status is Status.CERTIFIED))


def test_text_and_data_of_a_verdict(base: Ground) -> None:
    safe = verdict(base, Status.REACHABLE)
    assert str(safe) == "      keep, follow-lane REACHABLE"
    assert safe.to_dict() == {
        "longitudinal": "keep",
        "lateral": "follow-lane",
        "status": "REACHABLE",
        "first_empty_step": None,
        "reason": None,
        "duration_s": 0.25,
    }
    unsafe = verdict(base, Status.UNSAFE, True, "empty at step 0: a wall")
    assert str(unsafe) == "      keep, follow-lane UNSAFE: empty at step 0: a wall"
    assert unsafe.to_dict()["first_empty_step"] == 0
    assert unsafe.to_dict()["reason"] == "empty at step 0: a wall"
    both = Verdicts((safe, unsafe), base, ("R_G1",))
    assert str(both) == f"{safe}\n{unsafe}"
    assert both.to_list() == [safe.to_dict(), unsafe.to_dict()]
    assert list(both) == [safe, unsafe]
    assert both[1] is unsafe
    assert both[PAIR] is safe
    with pytest.raises(KeyError, match="was not verified"):
        both[ALL_PAIRS[-1]]
