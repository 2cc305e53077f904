"""What can go wrong, one class per action that a caller can take.

Messages name a parameter as Python does, between backquotes: "go on with `resume=True`". The library never speaks of options of
the command line, which shows such a name as its option, --resume (`volid.cli.common.in_options`).
"""


class VolidError(Exception):
    """Base of everything volid raises on purpose; its text is meant for the user, without a traceback."""


class InputError(VolidError):
    """Input is wrong: the text names file, row or key, what was found and what was expected. Mend it and call again."""


class OutputError(VolidError):
    """The result cannot be written where it was asked for; nothing was written. Choose another path."""


class NotDeterminedError(VolidError):
    """The data do not determine what was asked for. Measure more, or ask for less."""
