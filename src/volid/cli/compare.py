"""`volid compare`: what changed between solutions, and a series over time."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING, Any

from volid.cli.common import (
    add_output,
    check_figure,
    check_output,
    conclude,
    explain,
    print_json,
    write_figure,
)
from volid.cli.numbers import number
from volid.cli.progress import Progress

if TYPE_CHECKING:
    from volid.fitting.solution import Solution

HELP = "what changed significantly between solutions of one machine; three or more: a series over time"

_EPILOG = """\
All solutions are brought into one datum over the range that all have measured. Every function is
tested once, over all that is known of it, and false alarms are at most 5 % over all functions
together. What the solutions share cancels: the smoothness of the machine; an earlier solution that
was a prior of the later one; effects that all campaigns name alike ([[set.effect]] with the same u,
per = "campaign" or "tool"), such as the scale of one laser. --common NAME says so of others, such as
a calibrated length; --independent NAME says that it was another instrument.

Three solutions or more make a series: drift per function, steps that are no drift, and the date from
which a compensation made from the first survey no longer holds (--limit, mm; without it the U of the
first survey's own field). Dates are [conditions] date of the campaigns, or --dates.

example:
  volid compare january.h5 june.h5 --common "bar length" -o change.csv --figure change.svg
  volid compare a.h5 b.h5 c.h5 --dates 2026-01-10,2026-03-01,2026-06-15 --limit 0.010

exit status: 0 nothing changed; 1 written, and what changed significantly, or is in doubt, is named;
2 bad input
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    explain(parser, _EPILOG)
    parser.add_argument("solutions", metavar="SOLUTION.h5", nargs="+", help="two or more, written by volid fit")
    parser.add_argument("--datum", metavar="KEY=VALUE,…", help="primary, secondary, …; default: that of the first")
    parser.add_argument(
        "--common",
        metavar="NAME",
        action="append",
        default=[],
        help="effect or artefact that was the same one each time; repeatable",
    )
    parser.add_argument(
        "--independent",
        metavar="NAME",
        action="append",
        default=[],
        help="effect that was another one each time, although all campaigns name it alike; repeatable",
    )
    parser.add_argument(
        "--dates", metavar="D1,D2,…", help="of three solutions or more: dates, with time of day if need be, or numbers"
    )
    parser.add_argument(
        "--limit",
        metavar="L",
        type=number("mm", above=0.0),
        help="largest change of the field accepted in a series, mm",
    )
    parser.add_argument("--figure", metavar="FIGURE", help="the changes with their bands, .svg, .pdf or .png")
    add_output(parser, "OUT.csv", "every function over its range, CSV")


def run(args: argparse.Namespace) -> int:
    """Read, compare, write; 1 where something changed or is in doubt. Raises `InputError`, `OutputError`."""
    for path in (args.output, args.figure):
        check_output(path, args.force, args.solutions)
    check_figure(args.figure)
    _check_number(args)
    with Progress() as progress:
        progress("reading the solutions")
        from volid.io.solutions import read_solution

        solutions = [read_solution(path) for path in args.solutions]
        progress("comparing")
        show = _pair if len(solutions) == 2 else _series
        return show(args, solutions)


def _check_number(args: argparse.Namespace) -> None:
    """Raises `InputError` for one solution, or options that two of them have no use for."""
    from volid.exceptions import InputError

    count = len(args.solutions)
    if count < 2:
        raise InputError("one solution is given; expected two, or more for a series")
    if count == 2 and (args.dates or args.limit is not None):
        wrong = "--dates" if args.dates else "--limit"
        raise InputError(f"{wrong} is for a series of three solutions or more; two are given")


def _datum(args: argparse.Namespace, solutions: list[Solution]) -> Any:
    from volid.fitting.datum import parse_datum

    return parse_datum(solutions[0].machine, args.datum) if args.datum else None


def _pair(args: argparse.Namespace, solutions: list[Solution]) -> int:
    from volid.report.text.comparison import (
        CHANGE_COLUMNS,
        attention_of,
        change_rows,
        comparison_data,
        comparison_lines,
    )
    from volid.validation.solutions.comparison import compare

    names = (args.solutions[0], args.solutions[1])
    found = compare(
        *solutions, datum=_datum(args, solutions), common=args.common, independent=args.independent, names=names
    )
    if args.figure:
        from volid.report.plot.comparison import changes_figure

        write_figure(changes_figure(found), args.figure, args.force)
    _table(args, found.datum, CHANGE_COLUMNS, change_rows(found))
    _say(args, comparison_data(found), comparison_lines(found))
    return conclude(args, attention_of(found))


def _series(args: argparse.Namespace, solutions: list[Solution]) -> int:
    from volid.report.text.comparison import SERIES_COLUMNS, series_attention, series_data, series_lines, series_rows
    from volid.validation.solutions.dates import recorded_times, stated_times
    from volid.validation.solutions.series import series

    count = len(solutions)
    times = stated_times(args.dates, count) if args.dates else recorded_times(solutions, args.solutions)
    found = series(
        solutions,
        times.values,
        datum=_datum(args, solutions),
        common=args.common,
        independent=args.independent,
        limit=args.limit,
        names=args.solutions,
    )
    if args.figure:
        from volid.report.plot.comparison import series_figure

        write_figure(series_figure(found, times), args.figure, args.force)
    _table(args, found.datum, SERIES_COLUMNS, series_rows(found, times))
    _say(args, series_data(found, times), series_lines(found, times))
    return conclude(args, series_attention(found, times))


def _table(args: argparse.Namespace, datum: str, columns: tuple[str, ...], rows: Any) -> None:
    from volid.io.functions_csv import Sheet, text_output, write_csv

    if not args.output:
        return
    header = {
        "values": "change of error functions and constants, mm or rad, with standard uncertainty u (k = 1) of the change; an "
        "empty cell is not determined by the data",
        "beside": "where the second axis of a function of two axes stands",
        "datum": datum,
        "source": ", ".join(args.solutions),
    }
    with text_output(args.output, args.force) as stream:
        write_csv(stream, Sheet(header, columns, list(rows)))


def _say(args: argparse.Namespace, data: dict[str, Any], lines: list[str]) -> None:
    from volid.cli.common import in_options

    if args.json:
        print_json(data)
        return
    print(in_options("\n".join(lines), args))
    for path in filter(None, (args.output, args.figure)):
        print(f"written: {path}")
