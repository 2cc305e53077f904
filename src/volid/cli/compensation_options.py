"""Options that `tables`, `grid` and `residual` share: types, base, datum, sampling, ranges, and the rule of a user."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from types import ModuleType
from typing import TYPE_CHECKING, Any

from volid.cli.numbers import count, finite, number, tool_vector

if TYPE_CHECKING:
    from volid.compensation.base import Base
    from volid.compensation.tables.sampling import Sampling
    from volid.fitting.solution import Solution


def assignments(text: str) -> dict[str, float]:
    """ "X=500,Y=300" as numbers by axis letter, for argparse."""
    found: dict[str, float] = {}
    try:
        for part in text.split(","):
            key, value = part.split("=")
            _refuse_twice(key.strip(), found)
            found[key.strip()] = finite(value)
    except ValueError:
        raise argparse.ArgumentTypeError(f"'{text}' is no list of positions; expected such as X=500,Y=300") from None
    return found


def limits(text: str) -> dict[str, float]:
    """ "X=0.5,Y=0.3" as numbers above 0 by axis letter, for argparse."""
    found = assignments(text)
    wrong = next((f"{letter}={value:g}" for letter, value in found.items() if not value > 0.0), None)
    if wrong:
        raise argparse.ArgumentTypeError(f"{wrong}: expected a number > 0")
    return found


def scatter(text: str) -> dict[str, float] | float:
    """ "0.0004", or "X=0.0004,Y=0.0005" by axis letter, numbers of 0 or more, for argparse."""
    if "=" not in text:
        return number("mm", least=0.0)(text)
    found = assignments(text)
    wrong = next((f"{letter}={value:g}" for letter, value in found.items() if value < 0.0), None)
    if wrong:
        raise argparse.ArgumentTypeError(f"{wrong}: expected a number >= 0")
    return found


def _refuse_twice(letter: str, found: dict[str, Any]) -> None:
    """Raises `ArgumentTypeError` for an axis that already has a value, which the new one would replace unseen."""
    if letter in found:
        raise argparse.ArgumentTypeError(f"{letter} is given twice; expected every axis once")


class ByAxis(argparse.Action):
    """Values by axis letter; a repeated option adds its axes to those of the first, and an axis twice is refused."""

    def __call__(
        self,
        parser: argparse.ArgumentParser,
        namespace: argparse.Namespace,
        values: Any,
        option_string: str | None = None,
    ) -> None:
        """Called by argparse for every occurrence of the option."""
        before = getattr(namespace, self.dest) or {}
        twice = sorted(set(before) & set(values))
        if twice:
            parser.error(f"argument {option_string}: {', '.join(twice)} is given twice; expected every axis once")
        setattr(namespace, self.dest, {**before, **values})


def add_types(parser: argparse.ArgumentParser) -> None:
    """--type, repeated."""
    parser.add_argument(
        "--type",
        action="append",
        metavar="TYPE",
        required=True,
        help="type of compensation; repeat it to combine types",
    )


def add_base(parser: argparse.ArgumentParser, tool_help: str) -> None:
    """What a compensation is based on: --at, --tool, --elevation, --functions, --rule, --datum, --align, --rigid."""
    parser.add_argument(
        "--at",
        metavar="X=..,Y=..",
        type=assignments,
        action=ByAxis,
        help="where the specific lines cross; default: the datum's origin",
    )
    parser.add_argument("--tool", metavar="x,y,z", type=tool_vector, help=tool_help)
    parser.add_argument(
        "--elevation",
        metavar="H",
        type=number("mm"),
        default=0.0,
        help="of R-RAX and R-ANG above a table axis's point, mm",
    )
    parser.add_argument("--functions", metavar="EXX,EAX", help="functions that L-SPEC or R-SPEC corrects")
    parser.add_argument(
        "--rule", metavar="MODULE:FUNCTION", help="L-SPEC, R-SPEC by a Python rule; also FILE.py:FUNCTION"
    )
    parser.add_argument("--datum", metavar="primary=Z,…", help="datum after compensation (see volid datum)")
    parser.add_argument(
        "--align", choices=("axes", "spindle"), default="axes", help="align to the datum's axes or the spindle"
    )
    parser.add_argument(
        "--rigid", action="store_true", help="single-axis functions that leave least of a model with cross effects"
    )


def add_sampling(parser: argparse.ArgumentParser, kind: str) -> None:
    """--step, --max-points, --max-error, --offset."""
    parser.add_argument(
        "--step", metavar="S", type=number("mm or degrees", above=0.0), help=f"spacing of the {kind}, mm or degrees"
    )
    parser.add_argument("--max-points", metavar="N", type=count(2, 2000), help="at most so many points (per axis)")
    parser.add_argument(
        "--max-error",
        metavar="E",
        type=number("mm", above=0.0),
        help="fewest points that interpolate linearly within E mm",
    )
    parser.add_argument(
        "--offset",
        metavar="R",
        type=number("mm", above=0.0),
        help="offset of the tool from the axis at which E holds for rotations, mm",
    )


def spans(text: str) -> dict[str, tuple[float, float]]:
    """ "X=0:500,Y=0:300" as lowest and highest position by axis letter, for argparse."""
    found: dict[str, tuple[float, float]] = {}
    try:
        for part in text.split(","):
            key, value = part.split("=")
            low, high = value.split(":")
            _refuse_twice(key.strip(), found)
            found[key.strip()] = (finite(low), finite(high))
    except ValueError:
        raise argparse.ArgumentTypeError(f"'{text}' is no list of ranges; expected such as X=0:500,Y=0:300") from None
    return found


def add_range(parser: argparse.ArgumentParser, kind: str) -> None:
    """--range, --extrapolate."""
    parser.add_argument(
        "--range",
        metavar="X=0:500",
        type=spans,
        action=ByAxis,
        help=f"lowest and highest of the {kind} by axis, repeated or in one list; default: what was measured",
    )
    parser.add_argument(
        "--extrapolate",
        action="store_true",
        help=f"{kind} outside what was measured are intended; default: entire travel",
    )


def ranges_from(solution: Solution, args: argparse.Namespace) -> dict[str, tuple[float, float]]:
    """Over which positions tables and grids reach, by axis letter. Raises `InputError`."""
    from volid.compensation.ranges import chosen_ranges

    return chosen_ranges(solution, args.range, args.extrapolate)


def add_rounding(parser: argparse.ArgumentParser, kind: str) -> None:
    """--increment, --angle-increment, --zero."""
    parser.add_argument("--increment", metavar="D", type=number("mm", above=0.0), help="least increment of lengths, mm")
    parser.add_argument(
        "--angle-increment",
        metavar="D",
        type=number("degrees", above=0.0),
        help="least increment of rotations, degrees",
    )
    parser.add_argument("--zero", metavar="X=..", type=assignments, action=ByAxis, help=f"where {kind} are zero")


def sampling_of(args: argparse.Namespace, spacing: str = "equal") -> Sampling:
    """How tables or grids are sampled. Raises `InputError`."""
    from volid.compensation.tables.sampling import Sampling

    return Sampling(args.step, args.max_points, args.max_error, spacing, args.offset)


def in_frame(solution: Solution, args: argparse.Namespace) -> Solution:
    """The solution in the datum asked for."""
    if not args.datum:
        return solution
    from volid.fitting.datum import parse_datum

    return solution.in_datum(parse_datum(solution.machine, args.datum))


def prepared(
    solution: Solution, args: argparse.Namespace, tools: Sequence[Sequence[float]]
) -> tuple[Solution, list[str]]:
    """The solution in the datum asked for, rigid, and beyond what was measured when asked for; notes about what that does."""
    notes: list[str] = []
    known = len(solution.notes)
    solution = in_frame(solution, args)
    notes += [*solution.notes[known:], *_on_top(solution, args)]
    if args.rigid:
        import numpy as np

        from volid.compensation.rigid import best_rigid

        around = [np.add(t, d) for t in tools for d in ((0, 0, 0), (100, 0, 0), (0, 100, 0), (0, 0, 100))]
        solution, left = best_rigid(solution, np.array(around))
        notes.append(
            f"best rigid functions: RMS {1e3 * left.rms_before:.2f} µm before, {1e3 * left.rms:.2f} µm after, largest "
            f"{1e3 * left.maximum:.2f} µm, if the control knew them exactly; in the stated datum, for the tool vectors and "
            "others 100 mm beside them"
        )
    return (solution.extrapolated() if args.extrapolate else solution), notes


def _on_top(solution: Solution, args: argparse.Namespace) -> list[str]:
    """A note where a type was active while the campaign was measured: the values do not replace it (ISO/TR 16907 10.5)."""
    from volid.controllers.existing.state import active_types

    active = active_types(solution.campaign)
    again = [n.strip() for text in args.type for n in text.split(",") if n.strip() in active]
    if not again or getattr(args, "add_to", None) or getattr(args, "add_active", False):
        return []
    written = "; `add_to` writes the sum" if hasattr(args, "add_to") else ""
    return [
        f"{', '.join(dict.fromkeys(again))} was active while the campaign was measured ([conditions] active_compensations): the "
        f"values are what remains, and come on top of it{written}"
    ]


def base_from(solution: Solution, args: argparse.Namespace, tool: Sequence[float]) -> Base:
    """What the compensation is based on. Raises `InputError`, `NotDeterminedError`."""
    from volid.compensation.alignment import aligned_to_spindle
    from volid.compensation.base import base_of

    names = [n.strip() for n in args.functions.split(",")] if args.functions else []
    base = base_of(solution, tool, args.at, args.elevation, names)
    return aligned_to_spindle(solution, base) if args.align == "spindle" else base


def rule_from(text: str | None) -> Any:
    """The Python function that "package.module:function" or "file.py:function" names. Raises `InputError`."""
    from volid.exceptions import InputError

    if text is None:
        return None
    place, _, name = text.rpartition(":")
    if not place:
        raise InputError(f"--rule '{text}'; expected module:function or file.py:function")
    try:
        module = _module(place)
    except Exception as error:  # a user's file may fail in any way
        raise InputError(f"--rule {text}: {place} cannot be imported: {type(error).__name__}: {error}") from None
    function = getattr(module, name, None)
    if not callable(function):
        raise InputError(f"--rule {text}: {place} has no function '{name}'")
    return function


def _module(place: str) -> ModuleType:
    """A module by its name, or a Python file that ends in .py."""
    import importlib.util
    from pathlib import Path

    if not place.endswith(".py"):
        return importlib.import_module(place)
    spec = importlib.util.spec_from_file_location(Path(place).stem, place)
    if spec is None or spec.loader is None:
        raise ImportError(place)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module
