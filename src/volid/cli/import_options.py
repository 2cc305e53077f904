"""Options of `volid import` that say what a file of another program does not: keys of its `[[set]]`."""

from __future__ import annotations

import argparse
import textwrap
from typing import Any

from volid.cli.numbers import finite, number, tool_vector


def add_foreign(parser: argparse.ArgumentParser) -> None:
    """--as, --machine and the keys of a set."""
    group = parser.add_argument_group("files of other programs")
    group.add_argument("--as", dest="format", metavar="TYPE", help="type of the files; default: by their content")
    group.add_argument("--formats", action=_Formats, nargs=0, help="list the types that are read, and exit")
    group.add_argument("--machine", metavar="MACHINE.toml", help="the machine that was measured")
    group.add_argument(
        "--map",
        metavar="MAP",
        help="keys of a set for delimited text: a TOML file of them, or an earlier campaign, which remembers its own",
    )
    group.add_argument("--positions", metavar="CSV", help="axis positions that the files do not hold")
    group.add_argument("--axis", metavar="X", help="the axis that moved, where the file does not say")
    group.add_argument(
        "--at", metavar="Y=300,Z=-250", type=_positions, help="where axes stood that did not move, mm or degrees"
    )
    group.add_argument("--component", metavar="C", help="component of the deviation: X, Y, Z, A, B or C")
    group.add_argument("--tool", metavar="x,y,z", type=tool_vector, help="tool vector of what was measured, mm")
    group.add_argument(
        "--u", metavar="U", type=number("mm or rad", above=0.0), help="standard uncertainty of a reading"
    )
    group.add_argument("--unit", metavar="UNIT", help="unit of the readings, where it is not that of the type")
    group.add_argument("--encoding", metavar="NAME", help="encoding of the text, such as gbk; default: recognised")
    group.add_argument(
        "--key",
        metavar="NAME=VALUE",
        action="append",
        default=[],
        help="any other key of the set, its value as in TOML",
    )


class _Formats(argparse.Action):
    """Lists the types of files, as --version shows the version: importing them takes time that --help must not take."""

    def __call__(self, parser: argparse.ArgumentParser, *args: Any, **kwargs: Any) -> None:
        """Print and exit."""
        from volid.io.campaign import delimited
        from volid.io.instruments import FORMATS

        listed = [(name, known.words, known.about, known.keys) for name, known in FORMATS.items()]
        for name, words, about, keys in [*listed, (delimited.TEXT, delimited.WORDS, delimited.ABOUT, delimited.KEYS)]:
            text = f"{words}. {about}" + (f" Keys: {', '.join(keys)}." if keys else "")
            print(textwrap.fill(text, 100, initial_indent=f"{name}: ", subsequent_indent="  "))
        parser.exit()


def keys_of(args: argparse.Namespace) -> dict[str, Any]:
    """The keys of a set that the options state. Raises `InputError` for a --key that is none."""
    named = {name: getattr(args, name) for name in ("positions", "axis", "at", "component", "u", "unit", "encoding")}
    keys = {"as": args.format, "tool": None if args.tool is None else list(args.tool), **named}
    for text in args.key:
        keys |= key_of(text)
    return {name: value for name, value in keys.items() if value is not None}


def key_of(text: str) -> dict[str, Any]:
    """`NAME=VALUE` as TOML; a value that is none is taken as a text."""
    from volid.exceptions import InputError
    from volid.io.basics.toml_table import format_value, parse_toml

    name, sign, value = (part.strip() for part in text.partition("="))
    if not sign or not name.replace("_", "").isalnum() or not value or "\n" in text:
        raise InputError(f"--key '{text}': expected NAME=VALUE, such as one_way=true")
    try:
        return parse_toml(f"{name} = {value}", f"--key {name}")
    except InputError:
        return parse_toml(f"{name} = {format_value(value)}", f"--key {name}")


def _positions(text: str) -> dict[str, float]:
    """`Y=300,Z=-250` as positions by axis, for argparse."""
    found: dict[str, float] = {}
    for part in text.split(","):
        letter, sign, value = (piece.strip() for piece in part.partition("="))
        try:
            if not sign or not letter or letter in found:
                raise ValueError(part)
            found[letter] = finite(value)
        except ValueError:
            raise argparse.ArgumentTypeError(
                f"'{text[:40]}': expected a position of each axis once, such as Y=300,Z=-250"
            ) from None
    return found
