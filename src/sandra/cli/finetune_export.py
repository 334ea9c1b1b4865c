"""`sandra finetune export`: a model with its adapter as one folder, or as one file."""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path
from typing import Any

from sandra.cli.options import command
from sandra.cli.output import print_json, progress
from sandra.errors import SandraError


def add(actions: Any) -> None:
    parser = command(
        actions,
        "export",
        "write a model, its adapter added to the weights, as one folder, or, for Qwen3 models, "
        "as one GGUF file for llama.cpp, Ollama and the like (32-bit floats)",
        "sandra finetune export hf:my-model+runs/adapter --out tuned.gguf",
        "sandra decide merge --ranker gguf:tuned.gguf",
    )
    parser.add_argument("model", metavar="hf:FOLDER[+ADAPTER]", help="what is written")
    parser.add_argument(
        "--out", required=True, metavar="PATH", help="FILE.gguf, or a folder that is not there yet"
    )
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    parser.set_defaults(run=_run)


def _run(arguments: argparse.Namespace) -> int:
    from sandra.rankers.local.export import merge, to_gguf
    from sandra.rankers.local.spec import folders

    kind, colon, text = arguments.model.strip().partition(":")
    if kind != "hf" or not colon or "#" in text:
        raise SandraError(f"{arguments.model}: write hf:FOLDER or hf:FOLDER+ADAPTER")
    model, adapter = folders(text)
    out = Path(arguments.out)
    if not out.parent.is_dir():
        raise SandraError(f"{out}: there is no folder {out.parent}; make it first")
    progress("write")
    if out.suffix == ".gguf":
        with tempfile.TemporaryDirectory(prefix=".merged", dir=out.parent) as draft:
            whole = model if adapter is None else merge(model, adapter, Path(draft))
            to_gguf(whole, out)
    elif adapter is None:
        raise SandraError(f"{model} is such a folder already; name a --out that ends in .gguf")
    elif out.exists():
        raise SandraError(f"{out}: is there already; choose another --out")
    else:
        merge(model, adapter, out)
    progress("")
    ranker = f"gguf:{out}" if out.suffix == ".gguf" else f"hf:{out}"
    if arguments.json:
        print_json({"out": str(out), "ranker": ranker})
    else:
        print(f"written: {out}\nuse it: sandra decide merge --ranker {ranker}")
    return 0
