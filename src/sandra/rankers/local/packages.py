"""The packages of the extra `[local]`, imported where they are used."""

from __future__ import annotations

import importlib
from typing import Any

from sandra.errors import RankerError


def package(name: str) -> Any:
    """A module that need not be installed.

    Raises:
        RankerError: if it is not, with the command that installs it.
    """
    try:
        return importlib.import_module(name)
    except ImportError as error:
        raise RankerError(
            f"models in this process need the package '{name.partition('.')[0]}' ({error}); "
            f"install it: pip install 'sandra[local]'"
        ) from None
