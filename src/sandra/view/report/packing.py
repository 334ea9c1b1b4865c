"""Points and states as short text: whole numbers, differences, variable-length bytes, base64.

A stream of integers is written as differences, each in zigzag order (0, -1, 1, -2, ...) and in
groups of seven bits, low ones first, the eighth saying that more follow; the bytes in base64. The
page reads it back (`page/codec.js`); so do `unpack_frames` and `unpack_rows` here.

Lengths are in centimetres, angles in milliradians, speeds in cm/s: finer than a picture shows.
"""

from __future__ import annotations

import base64
from collections.abc import Sequence
from itertools import islice

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

PER_METRE = 100
"""Steps of a length, of a speed, and of an acceleration."""
PER_RADIAN = 1000
ABSENT = -(2**30)
"""Stands for a number that is not known (NaN, infinite)."""
FARTHEST = 2**30 - 1
"""No number is larger; a place 10,000 km away is drawn there."""


def pack_frames(frames: Sequence[Sequence[Array]]) -> str:
    """Frames (such as steps) of polylines or rings of points (n, 2) [m].

    The stream: number of frames; of each its number of lines; of each line its number of points,
    then x and y of each point minus those of the point before it in the stream.
    """
    lines = [np.asarray(line, dtype=float)[:, :2] for frame in frames for line in frame]
    points = whole(np.concatenate([np.zeros((1, 2)), *lines]) * PER_METRE)
    steps = iter(np.diff(points, axis=0).ravel().tolist())
    numbers = [len(frames)]
    for frame in frames:
        numbers.append(len(frame))
        for line in frame:
            numbers.append(len(line))
            numbers += islice(steps, 2 * len(line))
    return _text(np.array(numbers, dtype=np.int64))


def unpack_frames(text: str) -> list[list[Array]]:
    """What `pack_frames` has packed, to half a centimetre."""
    stream = iter(_integers(text).tolist())
    found: list[list[Array]] = []
    last = np.zeros(2, dtype=np.int64)
    for _ in range(next(stream)):
        lines = []
        for _ in range(next(stream)):
            steps = [[next(stream), next(stream)] for _ in range(next(stream))]
            points = last + np.cumsum(np.array(steps, dtype=np.int64).reshape(-1, 2), axis=0)
            last = points[-1] if len(points) else last
            lines.append(points / PER_METRE)
        found.append(lines)
    return found


def pack_rows(rows: Array, scales: Sequence[float]) -> str:
    """Rows (n, m) of numbers, each column times its scale; what is not finite is `ABSENT`.

    The stream: n, m, then row by row each number minus the one above it.
    """
    table = np.atleast_2d(np.asarray(rows, dtype=float))
    if table.size == 0:
        table = table.reshape(0, len(scales))
    numbers = whole(table * np.asarray(scales, dtype=float))
    above = np.vstack([np.zeros((1, numbers.shape[1]), dtype=np.int64), numbers[:-1]])
    return _text(
        np.concatenate([np.array(numbers.shape), (numbers - above[: len(numbers)]).ravel()])
    )


def unpack_rows(text: str, scales: Sequence[float]) -> Array:
    """What `pack_rows` has packed; NaN where nothing was known."""
    stream = _integers(text)
    n, m = stream[:2].tolist()
    numbers = np.cumsum(stream[2:].reshape(n, m), axis=0)
    return np.where(numbers == ABSENT, np.nan, numbers / np.asarray(scales, dtype=float))


def whole(values: Array) -> Integers:
    """Rounded, kept within +-`FARTHEST`; `ABSENT` where not finite."""
    known = np.isfinite(values)
    rounded = np.rint(np.clip(np.where(known, values, 0.0), -FARTHEST, FARTHEST)).astype(np.int64)
    return np.where(known, rounded, ABSENT)


def _text(numbers: Integers) -> str:
    zigzag = ((numbers << 1) ^ (numbers >> 63)).astype(np.uint64)
    groups = np.arange(0, 42, 7, dtype=np.uint64)
    pieces = (zigzag[:, None] >> groups) & np.uint64(127)
    more = (zigzag[:, None] >> (groups + np.uint64(7))) > 0
    used = np.hstack([np.ones((len(numbers), 1), dtype=bool), more[:, :-1]])
    data = (pieces | (more.astype(np.uint64) << np.uint64(7))).astype(np.uint8)
    return base64.b64encode(data[used].tobytes()).decode("ascii")


def _integers(text: str) -> Integers:
    found, value, shift = [], 0, 0
    for byte in base64.b64decode(text):
        value |= (byte & 127) << shift
        shift += 7
        if byte < 128:
            found.append((value >> 1) ^ -(value & 1))
            value, shift = 0, 0
    return np.array(found, dtype=np.int64)
