"""`sandra finetune openai`: a model at a provider's, tuned on our rows."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sandra.cli.options import command, prices_of
from sandra.cli.output import print_json, progress
from sandra.errors import SandraError

if TYPE_CHECKING:
    from sandra.learn.tuning.hosted import Hosted
    from sandra.learn.tuning.provider import Event, Job, Provider


def add(actions: Any) -> None:
    parser = command(
        actions,
        "openai",
        "tune a model at OpenAI's, or at a server that speaks its language: upload the rows, start "
        "a job, watch it, and tell how to rank with what comes out; costs money; interrupted, the "
        "job goes on, and the same command goes on watching; exit status 1 if the job fails or is "
        "cancelled",
        "sandra finetune openai data.jsonl --model MODEL --epochs 3 --prices prices.toml --out "
        "runs/tuned --yes",
        "sandra finetune openai --out runs/tuned",
        "sandra finetune openai --out runs/tuned --cancel",
    )
    parser.add_argument(
        "rows", metavar="DATA.jsonl", nargs="?", help="of 'sandra dataset build'; its splits train "
        "and validation are uploaded"
    )  # fmt: skip
    parser.add_argument("--model", metavar="NAME", help="a model that the provider tunes")
    parser.add_argument("--out", required=True, metavar="DIR", help="a new folder, or one begun")
    parser.add_argument("--job", metavar="ID", help="watch this job, started elsewhere")
    parser.add_argument("--cancel", action="store_true", help="stop the job of --out")
    parser.add_argument("--yes", action="store_true", help="spend the money without being asked")
    parser.add_argument("--base-url", metavar="URL", help="of an OpenAI-compatible server")
    parser.add_argument(
        "--epochs", type=int, metavar="N", help="passes over the rows (default: the provider's)"
    )
    parser.add_argument("--batch", type=int, metavar="N", help="rows of a step (default: likewise)")
    parser.add_argument(
        "--learning-rate", type=float, metavar="X", help="times the provider's own (default: 1)"
    )
    parser.add_argument("--suffix", metavar="TEXT", help="part of the tuned model's name")
    parser.add_argument("--seed", type=int, metavar="S", help="of the training")
    parser.add_argument(
        "--prices", metavar="FILE", help="a TOML file with prices of models, for an estimate"
    )
    parser.add_argument(
        "--every", type=float, default=10.0, metavar="SECONDS", help="look at the job so often"
    )
    parser.add_argument("--json", action="store_true", help="print one JSON object at the end")
    parser.set_defaults(run=_run)


def _run(arguments: argparse.Namespace) -> int:
    from sandra.learn.tuning.hosted import Hosted
    from sandra.learn.tuning.provider import Provider

    if not 0.0 < arguments.every < 1e6:
        raise SandraError(f"--every {arguments.every}: must be greater than 0")
    hosted = Hosted(Path(arguments.out))
    known = None if hosted.record is None else hosted.record.address
    provider = Provider(arguments.base_url or known, pause=min(1.0, arguments.every))
    if known not in (None, provider.address):
        raise SandraError(f"{hosted.out}: its job is at {known}; choose another --out")
    if arguments.cancel:
        return _end(hosted, hosted.cancel(provider), arguments.json)
    if arguments.job is not None:
        hosted.adopt(arguments.job, provider.address)
    elif arguments.rows is not None:
        _order(hosted, provider, arguments)
    job = _watch(hosted, provider, arguments)
    _draw(hosted)
    return _end(hosted, job, arguments.json)


def _order(hosted: Hosted, provider: Provider, arguments: argparse.Namespace) -> None:
    """Tell what it will cost, and stop unless that is agreed to."""
    from sandra.learn.rows import read_rows
    from sandra.learn.tuning.order import Order

    if arguments.model is None:
        raise SandraError("--model is missing: name a model that the provider tunes")
    order = Order(
        model=arguments.model,
        epochs=arguments.epochs,
        batch=arguments.batch,
        learning_rate=arguments.learning_rate,
        suffix=arguments.suffix,
        seed=arguments.seed,
    )
    rows = read_rows(Path(arguments.rows))
    price = prices_of(arguments).get(f"openai:{order.model}")
    estimate = hosted.prepare(rows, order, provider.address, price)
    if hosted.record is not None and hosted.record.job is not None:
        return  # It is paid already.
    print(f"{order.model} at {provider.address}: {estimate}", file=sys.stderr)
    if arguments.yes:
        return
    if not sys.stdin.isatty():
        raise SandraError("this uploads the rows and costs money; add --yes to go on")
    print("Upload the rows and start the job? [y/N] ", end="", file=sys.stderr, flush=True)
    if sys.stdin.readline().strip().lower() not in ("y", "yes"):
        raise SandraError("nothing was uploaded and nothing was started")


def _watch(hosted: Hosted, provider: Provider, arguments: argparse.Namespace) -> Job:
    def say(job: Job, event: Event | None) -> None:
        if event is None:
            progress(job.status)
        else:
            progress("")
            print(f"{job.status}: {event.message}", file=sys.stderr)

    begun = hosted.record is not None and hosted.record.job is not None
    try:
        number = hosted.start(provider, progress)
        progress("")
        if not begun:
            print(f"started {number}", file=sys.stderr)
        job = hosted.watch(provider, say, arguments.every)
    except KeyboardInterrupt:
        progress("")
        if hosted.record is not None and hosted.record.job is not None:
            print(
                f"{hosted.record.job} goes on without us: 'sandra finetune openai --out "
                f"{hosted.out}' watches it, with --cancel it is stopped",
                file=sys.stderr,
            )
        raise
    progress("")
    return job


def _draw(hosted: Hosted) -> None:
    from sandra.view.learning import learning_figure

    curve = hosted.losses()
    if curve.training or curve.validation:
        curve.write(hosted.out / "loss.csv")
        learning_figure(curve, hosted.out / "loss.png", per="token")


def _end(hosted: Hosted, job: Job, as_json: bool) -> int:
    ranker = f"openai:{job.fine_tuned_model}" if job.fine_tuned_model else None
    succeeded = job.status == "succeeded" and ranker is not None
    if as_json:
        told = job.model_dump(mode="json")
        print_json({**told, "ranker": ranker, "out": str(hosted.out)})
    elif succeeded:
        tokens = "" if job.trained_tokens is None else f", {job.trained_tokens} tokens trained"
        print(f"{job.id}: succeeded{tokens}\nmodel: {job.fine_tuned_model}")
        print(f"use it: sandra decide intersection --ranker '{ranker}'")
    else:
        print(f"{job.id}: {job.status}" + (f": {job.error}" if job.error else ""))
    return 0 if succeeded else 1
