"""Errors that a user can mend.

Every `SandraError` says in one line what is wrong, where, and how to mend it. The command line
prints that line and exits with status 2; nothing else is caught there.
"""


class SandraError(Exception):
    """Bad input from outside: one line that says what, where and how to mend it."""


class ScenarioError(SandraError):
    """A scenario file that cannot be read, or that does not describe a drivable situation."""


class SettingsError(SandraError):
    """A parameter or a settings file that cannot be used."""


class ActionError(SandraError):
    """An unknown action or action pair."""


class FormulaError(SandraError):
    """A formula that cannot be parsed, or names an unknown predicate or rule."""


class CertificateError(SandraError):
    """A certificate file that cannot be read, or a certificate that cannot be made of its parts."""


class RankerError(SandraError):
    """A ranker that cannot be set up (unknown name, missing key, unreadable file).

    What goes wrong later, while a ranker answers, is no exception: it is a named failure in the
    `Ranking`.
    """
