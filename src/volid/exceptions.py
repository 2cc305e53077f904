"""What can go wrong, one class per action that a caller can take."""


class VolidError(Exception):
    """Base of everything volid raises on purpose; its text is meant for the user, without a traceback."""


class InputError(VolidError):
    """Input is wrong: the text names file, row or key, what was found and what was expected. Mend it and call again."""


class OutputError(VolidError):
    """The result cannot be written where it was asked for; nothing was written. Choose another path."""


class NotDeterminedError(VolidError):
    """The data do not determine what was asked for. Measure more, or ask for less."""
