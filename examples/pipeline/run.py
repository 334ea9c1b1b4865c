"""From recorded traffic to a language model that drives: each stage by a command of `sandra`.

    python examples/pipeline/run.py --out runs/pipeline
    python examples/pipeline/run.py --out runs/tiny --size tiny

1. record    traffic of highway-env as CommonRoad scenarios, split by seed
2. label     what everybody did, as action pairs: how they are distributed
3. build     rows: the prompt of a moment, and the ranking that begins with what was driven
4. scratch   a small model of the Qwen3 architecture from nothing, with a tokenizer of its own
5. lora      an adapter beside it, by PEFT and TRL
6. export    both as one file for llama.cpp
7. evaluate  open loop on windows that neither has seen: what was driven against what they rank
8. drive     closed loop with that file: the model ranks, what it ranks is verified, then driven

Each command is printed before it runs, so that it can be given alone; what was interrupted goes on
with the same command line. The models are far too small and see far too little to be any good:
sizes are chosen for minutes, and are all that has to be changed (`Size`).
"""

from __future__ import annotations

import argparse
import shlex
import sys
import time
from dataclasses import dataclass
from pathlib import Path

from sandra.cli import main as sandra


@dataclass(frozen=True)
class Size:
    """How much of everything."""

    traffic: str
    """Options of what is recorded."""
    horizon: int
    """Steps that a label looks ahead [0.2 s]."""
    windows: str
    """Options of which moments become rows."""
    model: str
    """Options of the model from nothing."""
    adapter: str
    steps: int
    """Decisions in the closed loop."""


SIZES = {
    "small": Size(
        traffic="--environments highway,merge --densities 1 --lanes 3 --episodes 40 --duration 8",
        horizon=10,
        windows="--windows 2 --vehicles 12 --balance 40",
        model="--width 128 --layers 3 --inner 256 --vocabulary 1024 --epochs 4",
        adapter="--rank 8 --epochs 2",
        steps=15,
    ),
    "tiny": Size(
        traffic="--environments highway --densities 0.5 --lanes 2 --episodes 3 --seed 7 "
        "--duration 2 --warm-up 1",
        horizon=5,
        windows="--windows 1 --vehicles 4",
        model="--width 64 --layers 1 --inner 64 --vocabulary 400 --steps 4 --batch 2",
        adapter="--rank 2 --epochs 1 --batch 2 --measure 2",
        steps=2,
    ),
}


def stages(out: Path, size: Size) -> dict[str, str]:
    """By name, the command lines, without their first word."""
    data, rows, model = f"{out}/data", f"{out}/data.jsonl", f"hf:{out}/small/model"
    tuned, file = f"{model}+{out}/adapter", f"{out}/tuned.gguf"
    return {
        "record": f"dataset record --out {data} {size.traffic}",
        "label": f"label {data} --horizon {size.horizon} --ego all --windows 1 --out {out}/labels",
        "build": f"dataset build {data} --out {rows} --horizon {size.horizon} {size.windows}",
        "scratch": f"finetune scratch {rows} --out {out}/small {size.model}",
        "lora": f"finetune lora {rows} --model {model} --out {out}/adapter {size.adapter}",
        "export": f"finetune export {tuned} --out {file}",
        "evaluate": f"evaluate open-loop {data} --rows {rows} --horizon {size.horizon} "
        f"--label-horizon {size.horizon} --ranker '{model}#mode=score&calibrate=length' "
        f"--ranker '{tuned}#mode=score&calibrate=length' --out {out}/open-loop",
        "drive": f"drive highway --seeds 5838 --steps {size.steps} --ranker gguf:{file} "
        f"--rules R_G1,R_G2,R_G3 --out {out}/drive",
    }


def run(out: Path, size: Size) -> dict[str, float]:
    """Run all stages; by name, how long each took [s].

    Raises:
        SystemExit: a stage that ends with another exit status than 0.
    """
    took = {}
    for name, words in stages(out, size).items():
        print(f"\n$ sandra {words}\n", flush=True)
        begin = time.monotonic()
        sys.argv = ["sandra", *shlex.split(words)]  # what cards say that they were made by
        status = sandra(sys.argv[1:])
        if status != 0:
            raise SystemExit(f"{name} ends with exit status {status}")
        took[name] = time.monotonic() - begin
    return took


def main(words: list[str] | None = None) -> None:
    """Of the command line."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--out", type=Path, default=Path("runs/pipeline"), help="a folder")
    parser.add_argument("--size", choices=tuple(SIZES), default="small")
    chosen = parser.parse_args(words)
    took = run(chosen.out, SIZES[chosen.size])
    print(f"\n{'stage':10} {'time [s]':>9}")
    for name, seconds in {**took, "in all": sum(took.values())}.items():
        print(f"{name:10} {seconds:9.1f}")


if __name__ == "__main__":
    sys.exit(main())
