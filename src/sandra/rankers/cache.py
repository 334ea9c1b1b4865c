"""Answers kept on disk, by all that they depend on: server, model, parameters, messages, schema.

One JSON file for each, which a person can read. Only answers that made a whole ranking are kept,
never a failure, and never a key: neither the question nor the file knows it.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import logging
import os
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from sandra.errors import RankerError

logger = logging.getLogger(__name__)

_FORMAT = 1


@dataclass(frozen=True, slots=True)
class Kept:
    """An answer, and how long the server took for it [s]."""

    text: str
    duration: float


class Cache:
    """A folder of answers. Usable from several threads and processes.

    Raises:
        RankerError: if the folder cannot be made or written.
    """

    def __init__(self, folder: str | Path) -> None:
        self.folder = Path(folder)
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            with tempfile.TemporaryFile(dir=self.folder):
                pass
        except OSError as error:
            raise RankerError(
                f"{folder}: no answers can be kept there ({error.strerror}); choose another --cache"
            ) from None

    def file(self, question: dict[str, Any]) -> Path:
        """Where the answer to a question is, or will be."""
        text = json.dumps(question, sort_keys=True, ensure_ascii=False)
        name = hashlib.sha256(text.encode("utf-8", "surrogatepass")).hexdigest()
        return self.folder / f"{name}.json"

    def get(self, question: dict[str, Any]) -> Kept | None:
        """The answer to a question; None, with a warning, if its file cannot be used."""
        file = self.file(question)
        try:
            data = json.loads(file.read_text(encoding="utf-8"))
            if data["format"] != _FORMAT or data["question"] != question:
                raise ValueError("it is about something else")
            text, duration = data["answer"], float(data["duration_s"])
            if not isinstance(text, str) or not 0.0 <= duration < float("inf"):
                raise ValueError("it holds no answer")
        except FileNotFoundError:
            return None
        except (OSError, ValueError, KeyError, TypeError, RecursionError) as error:
            logger.warning("%s: not used, the server is asked (%s)", file, error or "broken")
            return None
        return Kept(text, duration)

    def put(self, question: dict[str, Any], kept: Kept) -> None:
        """Keep an answer; what cannot be written is told in a warning and not kept."""
        file = self.file(question)
        data = {
            "format": _FORMAT,
            "question": question,
            "answer": kept.text,
            "duration_s": kept.duration,
        }
        draft = None
        try:
            text = json.dumps(data, indent=1, ensure_ascii=False)
            with tempfile.NamedTemporaryFile(
                "w", encoding="utf-8", dir=self.folder, suffix=".draft", delete=False
            ) as out:
                draft = out.name
                out.write(text)
            os.replace(draft, file)
        except (OSError, ValueError) as error:
            logger.warning("%s: the answer is not kept (%s)", file, error)
            if draft is not None:
                with contextlib.suppress(OSError):
                    os.unlink(draft)
