"""Keys stay out of whatever is told, written or logged.

A server knows the key that it was sent, and may say it: in the text of an error, in an answer, in a
header. Word for word it is replaced wherever such text enters. (Who means ill can send it in
disguise, letter by letter, but knows it already.)
"""

from __future__ import annotations

import logging

SHORTEST = 8
"""Shorter keys are placeholders such as "EMPTY", and words of ordinary text [characters]."""
HIDDEN = "[key]"

_LOGGERS = (
    "httpcore2.connection",
    "httpcore2.http11",
    "httpcore2.http2",
    "httpcore2.proxy",
    "httpcore2.socks",
    "httpx2",
    "openai",
    "openai._base_client",
    "sandra.rankers.bounded",
)


class Secret:
    """Takes one key out of texts; its own text and `repr` do not tell it."""

    def __init__(self, key: str | None = None) -> None:
        self._key = key if key is not None and len(key) >= SHORTEST else None

    def __call__(self, text: str) -> str:
        """`text` without the key; at its end also without a key that is cut off."""
        if self._key is None:
            return text
        text = text.replace(self._key, HIDDEN)
        for size in range(min(len(self._key) - 1, len(text)), SHORTEST - 1, -1):
            if text.endswith(self._key[:size]):
                return text[:-size] + HIDDEN
        return text

    def __repr__(self) -> str:
        return "Secret()"


class _Veil(logging.Filter):
    """Takes keys out of log records, such as those of the libraries at level DEBUG."""

    def filter(self, record: logging.LogRecord) -> bool:
        told = record.getMessage()
        if hidden(told) != told:
            record.msg, record.args = hidden(told), ()
        if record.exc_info and not record.exc_text:
            # Formatters take this text as it is, instead of making their own.
            record.exc_text = hidden(logging.Formatter().formatException(record.exc_info))
        return True


_secrets: dict[str, Secret] = {}
_veil = _Veil()


def hidden(text: str) -> str:
    """`text` without any key that this process has sent."""
    for secret in tuple(_secrets.values()):
        text = secret(text)
    return text


def veil_logs(key: str) -> None:
    """From now on this key is in no log record of ours, or of the libraries that send it."""
    if len(key) < SHORTEST:
        return
    _secrets[key] = Secret(key)
    for name in _LOGGERS:
        logging.getLogger(name).addFilter(_veil)  # twice is once
