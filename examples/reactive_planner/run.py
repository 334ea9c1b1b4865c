"""A published planner inside our corridor, and a certificate for what it plans.

    python examples/reactive_planner/run.py intersection decelerate,follow-lane
    python examples/reactive_planner/run.py --all

Our side verifies the pair and writes its corridor to a file; commonroad-reactive-planner, in an
environment of its own (`make .venv-planner`), reads the file and plans (plan.py); our side takes
the trajectory back, certifies it, has the certificate checked from its file, and draws a picture.
"""

import argparse
import json
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import sandra
from sandra.certificate import check_file, save

HERE = Path(__file__).resolve().parent
PYTHON = HERE.parents[1] / ".venv-planner" / "bin" / "python"
LONGEST = 300.0
"""The planner may take so long [s]."""


def planned(corridor: dict, folder: Path) -> dict:
    """What the planner answers to a corridor: see plan.py."""
    asked, answered = folder / "corridor.json", folder / "trajectory.json"
    asked.write_text(json.dumps(corridor), encoding="utf-8")
    answered.unlink(missing_ok=True)
    finished = subprocess.run(
        [PYTHON, "-I", HERE / "plan.py", asked, answered],
        cwd=folder,
        capture_output=True,
        text=True,
        timeout=LONGEST,
        check=False,
    )
    if finished.returncode != 0 or not answered.exists():
        raise SystemExit(f"the planner failed:\n{finished.stderr[-2000:]}")
    return json.loads(answered.read_text(encoding="utf-8"))


def certified(verdicts: sandra.Verdicts, pair: sandra.ActionPair, folder: Path) -> dict:
    """The planner's trajectory for a REACHABLE pair, and the verdict on it."""
    answer = planned(verdicts.corridor(pair), folder)
    if answer["states"] is None:
        return {
            **answer,
            "verdict": None,
            "said": "the planner finds no trajectory in the corridor",
        }
    verdict = sandra.certify_trajectory(verdicts, pair, answer["states"], step=answer["step"])
    said = verdict.reason
    if verdict.status is sandra.Status.CERTIFIED:
        file = save(verdict.proof.certificate, folder / "certificate.json")
        report = check_file(file)
        said = f"{'accepted' if report.accepted else 'rejected'} by the checker, read from its file"
    return {**answer, "verdict": verdict, "said": said}


def one(name: str, pair: str, folder: Path, rules: tuple[str, ...], prediction: str) -> int:
    scene = sandra.load(sandra.example(name) if name in sandra.examples() else name)
    verdicts = sandra.verify(scene, pair, rules=rules, prediction=prediction)
    print(f"{scene.name}: {verdicts[0]}")
    if verdicts[0].status is sandra.Status.UNSAFE:
        return 1
    found = certified(verdicts, verdicts[0].pair, folder)
    counts = f"{found['samples']} samples in the corridor, {found['infeasible']} not drivable, "
    print(f"{found['planner']}: {counts}{found['colliding']} colliding")
    print(f"{'no trajectory' if found['verdict'] is None else found['verdict']} ({found['said']})")
    if found["verdict"] is None:
        return 1
    from picture import draw

    print(f"picture: {draw(verdicts, found['verdict'], found['states'], folder / 'planner.png')}")
    return 0 if found["verdict"].status is sandra.Status.CERTIFIED else 1


def table(folder: Path, names: list[str], rules: tuple[str, ...], prediction: str) -> Iterator[str]:
    """A line per pair that is not UNSAFE: whether ours and theirs are certified."""
    for name in names:
        scene = sandra.load(sandra.example(name))
        decision = sandra.decide(
            scene, "rules", rules=rules, prediction=prediction, walk="all", k=12
        )
        for verdict in decision.verdicts:
            if verdict.status is sandra.Status.UNSAFE:
                continue
            found = certified(decision.verdicts, verdict.pair, folder)
            theirs = "-" if found["verdict"] is None else found["verdict"].status.value
            pair = f"{verdict.pair.longitudinal.value},{verdict.pair.lateral.value}"
            yield f"| {name} | {pair} | {verdict.status.value} | {theirs} | {found['said']} |"


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("scenario", nargs="?", default="intersection")
    parser.add_argument("pair", nargs="?", default="decelerate,follow-lane")
    parser.add_argument("--all", action="store_true", help="every pair of every shipped scenario")
    parser.add_argument("--rules", default="", help="e.g. R_G1,R_G2,R_G3")
    parser.add_argument("--prediction", default="most-likely")
    parser.add_argument("--output", type=Path, default=Path("demo"), help="folder for the files")
    arguments = parser.parse_args()
    if not PYTHON.exists():
        print(f"{PYTHON} is missing: run 'make example-planner'", file=sys.stderr)
        return 2
    arguments.output.mkdir(parents=True, exist_ok=True)
    folder = arguments.output.resolve()
    rules = tuple(rule for rule in arguments.rules.split(",") if rule)
    if not arguments.all:
        return one(arguments.scenario, arguments.pair, folder, rules, arguments.prediction)
    for line in table(folder, list(sandra.examples()), rules, arguments.prediction):
        print(line, flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
