"""One certificate, one file: JSON with plain lists of numbers, gzip if the name ends in `.gz`.

Numbers are written so that they come back bit for bit; NaN (a participant that is absent) is
null; an infinite parameter is "inf". Predicted regions, tens of thousands of them, are packed: how
many in each interval, how many vertices in each, and the numbers as base64 of little-endian
doubles. A reader refuses other versions, missing and unknown keys,
and whatever is not of the kind that belongs there.
"""

from __future__ import annotations

import gzip
import json
import zlib
from pathlib import Path

from sandra.certificate.reading import from_json
from sandra.certificate.types import Certificate
from sandra.certificate.writing import to_json
from sandra.errors import CertificateError

LARGEST_FILE = 1 << 30
"""More bytes than this, unpacked, are no certificate."""


def save(certificate: Certificate, path: str | Path) -> Path:
    """Write a certificate.

    Raises:
        CertificateError: if the file cannot be written.
    """
    text = json.dumps(to_json(certificate), allow_nan=False, indent=None, separators=(",", ":"))
    data = text.encode("utf-8")
    target = Path(path)
    try:
        # Without a time of writing equal certificates are equal files.
        packed = gzip.compress(data, mtime=0) if target.suffix == ".gz" else data
        target.write_bytes(packed)
    except OSError as error:
        raise CertificateError(f"{path}: cannot be written ({error.strerror})") from None
    return target


def load(path: str | Path) -> Certificate:
    """Read a certificate; whether it holds is for `check` to say.

    Raises:
        CertificateError: if the file cannot be read, or is no certificate of a known version.
    """
    try:
        if Path(path).suffix == ".gz":
            with gzip.open(path) as file:
                data = file.read(LARGEST_FILE + 1)
        else:
            with open(path, "rb") as file:
                data = file.read(LARGEST_FILE + 1)
    except (OSError, EOFError, zlib.error) as error:
        why = getattr(error, "strerror", None) or str(error)
        raise CertificateError(f"{path}: cannot be read ({why}); check the path") from None
    if len(data) > LARGEST_FILE:
        raise CertificateError(f"{path}: larger than {LARGEST_FILE} bytes, no certificate")
    try:
        tree = json.loads(data, parse_constant=_no_constant)
    except (ValueError, RecursionError) as error:
        raise CertificateError(f"{path}: not a JSON file ({error})") from None
    try:
        return from_json(tree)
    except CertificateError as error:
        raise CertificateError(f"{path}: {error}") from None


def _no_constant(name: str) -> float:
    raise ValueError(f"{name} is no JSON")
