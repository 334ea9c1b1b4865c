"""What runs on a worker of a cluster. Nothing but bytes comes and goes."""

from __future__ import annotations

import logging
import pickle
import zlib
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

from sandra.evaluation.workers.items import Broken, attempt
from sandra.scene.sent import sent

logger = logging.getLogger(__name__)


def packed(work: Callable[[Any], Any], item: Any, files: Iterable[Path]) -> bytes:
    """An item on its way, with the content of those of its files that can be read."""
    contents = {}
    for path in files:
        try:
            contents[path] = path.read_bytes()
        except OSError:
            continue  # What is said about it is for `work` to say.
    return zlib.compress(pickle.dumps((work, item, contents)), 1)


def answered(parcel: bytes) -> bytes:
    """The answer to a `packed` item, packed."""
    work, item, files = pickle.loads(zlib.decompress(parcel))
    with sent(files):
        answer = attempt(work, item)
    try:
        data = pickle.dumps(answer)
    except Exception as error:
        logger.exception("the answer to %r cannot be sent", item)
        data = pickle.dumps(Broken(f"{type(error).__name__}: the answer cannot be sent"))
    return zlib.compress(data, 1)


def unpacked(parcel: bytes) -> Any:
    """What `answered` packed."""
    return pickle.loads(zlib.decompress(parcel))


def asked_who() -> Callable[[], dict[str, str]]:
    """A function that says which SanDRA a worker has, even one without this module.

    It is sent by value, not by name, since it is no function of the module.
    """

    def who() -> dict[str, str]:
        from sandra.evaluation.workers.identity import identity

        return identity()

    return who
