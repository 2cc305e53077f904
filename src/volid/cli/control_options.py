"""What a simulated control can do, as options that `residual` and `simulate` share, and the control of `simulate`."""

from __future__ import annotations

import argparse
import re
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from volid.cli.compensation_options import ByAxis, limits
from volid.cli.numbers import number, tool_vector

if TYPE_CHECKING:
    from volid.compensation.control import Control
    from volid.controllers.existing.reading import ExistingCompensation
    from volid.model.machine import Machine


def add_control_limits(parser: argparse.ArgumentParser) -> None:
    """--increment, --clamp, --smoothing, --poles, --pole-margin."""
    parser.add_argument(
        "--increment",
        metavar="X=..",
        type=limits,
        action=ByAxis,
        help="least increments of the axes, mm or degrees",
    )
    parser.add_argument("--clamp", metavar="A,C", help="axes that stay clamped")
    parser.add_argument(
        "--smoothing",
        metavar="X=..",
        type=limits,
        action=ByAxis,
        help="lengths over which the control averages tables and grids, mm or degrees",
    )
    parser.add_argument("--poles", choices=("limit", "keep out"), default="limit", help="near kinematic poles")
    parser.add_argument(
        "--pole-margin",
        metavar="D",
        type=number("degrees", above=0.0, most=45.0),
        default=5.0,
        help="where that begins, degrees; default 5",
    )


def control_limits(args: argparse.Namespace) -> dict[str, Any]:
    """The options as those of `volid.Control`."""
    from volid.compensation.orientation import PoleRule

    return {
        "poles": PoleRule(args.pole_margin, args.poles),
        "increment": args.increment or {},
        "smoothing": args.smoothing or {},
        "clamped": tuple(a.strip() for a in args.clamp.split(",")) if args.clamp else (),
    }


def add_control(parser: argparse.ArgumentParser) -> None:
    """--compensation, --control-tool, and what the control can do."""
    parser.add_argument(
        "--compensation",
        metavar="FILE",
        nargs="+",
        action="extend",
        default=[],
        help="tables and grids that are active, or folders of them: of volid tables, grid and field, or files of a control",
    )
    add_files_of(parser, "compensation-")
    parser.add_argument(
        "--control-tool",
        metavar="x,y,z",
        type=tool_vector,
        help="tool vector that the control uses, mm; default: the true one of every reading",
    )
    add_control_limits(parser)


def add_files_of(parser: argparse.ArgumentParser, before: str = "", of: str = "the files") -> None:
    """--cnc, --sign and --option of existing files of a control, with a word `before` each."""
    parser.add_argument(
        f"--{before}cnc", metavar="NAME", help=f"control whose files {of} are; default: recognised by content"
    )
    parser.add_argument(
        f"--{before}sign",
        choices=("error", "compensation"),
        help="sense of their values, where public sources leave it open",
    )
    parser.add_argument(
        f"--{before}option",
        metavar="K=V",
        type=one_option,
        action="append",
        default=[],
        help="an option of that control (volid export --cnc NAME --explain); repeat it",
    )


@contextmanager
def in_words_of(**called: str) -> Iterator[None]:
    """Messages about files of a control name the options that the verb has for them: with sign="to_sign" `sign` becomes that.

    >>> from volid.exceptions import InputError
    >>> with in_words_of(sign="to_sign"):
    ...     raise InputError("state `sign=error`")
    Traceback (most recent call last):
    volid.exceptions.InputError: state `to_sign=error`
    """
    from volid.exceptions import InputError

    try:
        yield
    except InputError as error:
        pattern = rf"`({'|'.join(called)})(?=[=`])"
        raise InputError(re.sub(pattern, lambda found: f"`{called[found[1]]}", str(error))) from None


def one_option(text: str) -> tuple[str, str]:
    """ "comp_file_type=1" as key and value, for argparse."""
    key, found, value = text.partition("=")
    if not found or not key.strip():
        raise argparse.ArgumentTypeError(f"'{text}' is no option of a control; expected KEY=VALUE")
    return key.strip(), value.strip()


def control_from(args: argparse.Namespace, machine: Machine) -> Control | None:
    """The control with the files of --compensation; None without. Raises `InputError`, also for options that need files."""
    from volid.exceptions import InputError
    from volid.io.compensations import load_control
    from volid.model.requests import ask_tools

    if args.compensation:
        if args.control_tool:
            ask_tools(machine, [args.control_tool], name="`control_tool`")
        of = {"cnc": args.compensation_cnc, "sign": args.compensation_sign}
        of |= {"control_options": dict(args.compensation_option)}
        with in_words_of(cnc="compensation_cnc", sign="compensation_sign"):
            control = load_control(machine, args.compensation, tool=args.control_tool, **of, **control_limits(args))
        if not (control.tables or control.grids or control.axis_tables):
            raise InputError(
                f"{', '.join(args.compensation)}: holds no table or grid (*.csv, *.h5); expected at least one"
            )
        return control
    idle = [n for n in ("control_tool", "increment", "clamp", "smoothing") if getattr(args, n)]
    if idle:
        raise InputError(
            f"`{idle[0]}` says how a control compensates, and no compensation is given; name its files with `compensation`"
        )
    return None


def loaded_files(args: argparse.Namespace, machine: Machine) -> tuple[ExistingCompensation, ...]:
    """The files of --compensation, volid's own and those of a control. Raises `InputError`."""
    from volid.io.control_files import existing_of

    options = dict(args.compensation_option)
    with in_words_of(cnc="compensation_cnc", sign="compensation_sign"):
        return existing_of(
            machine, args.compensation, args.compensation_cnc, sign=args.compensation_sign, options=options
        )
