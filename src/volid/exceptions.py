"""What can go wrong, one class per action that a caller can take.

Messages name a parameter as Python does, between backquotes: "go on with `resume=True`". The library never speaks of options of
the command line, which shows such a name as its option, --resume (`volid.cli.common.in_options`).
"""


class VolidError(Exception):
    """Base of everything volid raises on purpose; its text is meant for the user, without a traceback.

    >>> issubclass(InputError, VolidError) and issubclass(NotDeterminedError, VolidError)
    True
    """


class InputError(VolidError):
    """Input is wrong: the text names file, row or key, what was found and what was expected. Mend it and call again.

    >>> import volid
    >>> volid.load_machine("nowhere.toml")
    Traceback (most recent call last):
    ...
    volid.exceptions.InputError: nowhere.toml: there is no such file; check the name and the folder
    """


class OutputError(VolidError):
    """The result cannot be written where it was asked for; nothing was written. Choose another path.

    >>> import volid
    >>> campaign = volid.load_campaign("datasets/published_positioning/campaign.toml")
    >>> volid.save_campaign(campaign, "README.md")
    Traceback (most recent call last):
    ...
    volid.exceptions.OutputError: README.md exists; choose another name or pass `overwrite=True`
    """


class NotDeterminedError(VolidError):
    """The data do not determine what was asked for. Measure more, or ask for less.

    A single number that is not determined is NaN instead; this is raised where nothing useful would be left.

    >>> raise NotDeterminedError("grid: the data do not determine dZ for tool vector (0, 0, -150) mm.")
    Traceback (most recent call last):
    ...
    volid.exceptions.NotDeterminedError: grid: the data do not determine dZ for tool vector (0, 0, -150) mm.
    """
