"""A proof that somebody else can check: what a certificate is, how it is kept, and its checker.

`certificate` puts one together, `save` and `load` keep it in a file, `check` and `check_file` say
whether it holds.
"""

from sandra.certificate.build import certificate
from sandra.certificate.check import CONDITIONS, check, check_file
from sandra.certificate.file import load, save
from sandra.certificate.report import Checked, Report, Violation
from sandra.certificate.types import FORMAT, Certificate

__all__ = [
    "CONDITIONS",
    "FORMAT",
    "Certificate",
    "Checked",
    "Report",
    "Violation",
    "certificate",
    "check",
    "check_file",
    "load",
    "save",
]
