"""The packages of the extras `[local]` and `[finetune]`, imported where they are used."""

from __future__ import annotations

import importlib
from typing import Any

from sandra.errors import RankerError

_TO_TUNE = ("trl", "datasets", "accelerate")


def package(name: str) -> Any:
    """A module that need not be installed.

    Raises:
        RankerError: if it is not, with the command that installs it.
    """
    try:
        return importlib.import_module(name)
    except ImportError as error:
        top = name.partition(".")[0]
        extra = "local,finetune" if top in _TO_TUNE else "local"
        raise RankerError(
            f"models in this process need the package '{top}' ({error}); "
            f"install it: pip install 'sandra[{extra}]'"
        ) from None
