"""What can go wrong, one class per action that a caller can take.

Messages name a parameter as Python does, between backquotes: "go on with `resume=True`". The library never speaks of options of
the command line, which shows such a name as its option, --resume (`volid.cli.common.in_options`).

What files hold is foreign: a message shows control characters escaped, because a terminal would obey them, and what stands in
quotes cut to 80 characters.
"""

import json
import re
import unicodedata

QUOTED, LONGEST = 80, 4000  # characters of a quoted text, and of a message
_SUSPECT = re.compile("[^\t\n -~]")
_QUOTATION = re.compile(r"(?<!\w)'(.*?)'(?!\w)", re.DOTALL)


def shown(text: str, as_json: bool = False) -> str:
    """The text with control characters escaped, for a terminal or a file that people read; tabs and line ends stay.

    So are marks that turn the direction of writing or have no width, and the bytes of a file name that is no text. `as_json`: the
    text is JSON, and remains the same JSON.

    >>> print(shown("a" + chr(27) + "[2J"))
    a\\x1b[2J
    """
    return _SUSPECT.sub(_in_json if as_json else _escaped, text)


def cut(text: str, longest: int = QUOTED) -> str:
    """The text, or its beginning and "…", of at most `longest` characters."""
    return text if len(text) <= longest else text[: longest - 1] + "…"


def _is_visible(character: str) -> bool:
    return character.isprintable() or unicodedata.category(character) == "Zs"


def _escaped(match: re.Match[str]) -> str:
    code = ord(match.group())
    if _is_visible(match.group()):
        return match.group()
    if 0xDC80 <= code <= 0xDCFF:  # how Python keeps a byte of a file name that is no UTF-8
        code -= 0xDC00
    return f"\\x{code:02x}" if code < 0x100 else f"\\u{code:04x}"


def _in_json(match: re.Match[str]) -> str:
    return match.group() if _is_visible(match.group()) else json.dumps(match.group())[1:-1]


def _brief(message: str) -> str:
    """The message with long quotations cut, and cut itself in its middle, where lists of names stand."""
    text = _without_middle(message, 3 * LONGEST)  # what is quoted is found in a time that grows with the square
    return _without_middle(_QUOTATION.sub(lambda match: f"'{cut(match[1])}'", text), LONGEST)


def _without_middle(text: str, longest: int) -> str:
    return text if len(text) <= longest else f"{text[: longest * 3 // 4]} … {text[-longest // 4 :]}"


class VolidError(Exception):
    """Base of everything volid raises on purpose; its text is meant for the user, without a traceback.

    >>> issubclass(InputError, VolidError) and issubclass(NotDeterminedError, VolidError)
    True
    """

    def __str__(self) -> str:
        """The message as it may be printed: escaped, long quotations cut."""
        return _brief(shown(super().__str__()))


class InputError(VolidError):
    """Input is wrong: the text names file, row or key, what was found and what was expected. Correct it and call again.

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

    A single number that is not determined is NaN instead. This error is raised when no useful result would remain.

    >>> raise NotDeterminedError("grid: the data do not determine dZ for tool vector (0, 0, -150) mm.")
    Traceback (most recent call last):
    ...
    volid.exceptions.NotDeterminedError: grid: the data do not determine dZ for tool vector (0, 0, -150) mm.
    """
