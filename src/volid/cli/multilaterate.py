"""`volid multilaterate`: coordinates of stations and targets from distances alone, free or with fixed points."""

from __future__ import annotations

import argparse
import os
import sys

import numpy as np

from volid.cli.common import check_output, in_options, print_json
from volid.cli.numbers import count, seed
from volid.exceptions import InputError, OutputError
from volid.io.network_results import (
    Spread,
    coordinates_csv,
    write_coordinates,
    write_ellipsoids,
    write_offsets,
    write_residuals,
)
from volid.io.networks import network_from_csv
from volid.multilateration import NetworkSolution, network_trials
from volid.report.text.network import as_objects, attention, notes, summary

MOST_TRIALS = 1_000_000
HELP = "coordinates of a distance network, free or with fixed points, without a machine model"

_EPILOG = """\
NETWORK.csv has the columns from,to,distance,u; POINTS.csv has point,x,y,z,fixed (no z: a plane network; fixed: 0 or 1,
optional). One unit of length throughout. Without fixed points the result lies as near to POINTS.csv as the distances
allow (inner constraints); without POINTS.csv its frame is arbitrary, mirror image included.

relative distances (interferometers, wires, belts: unknown dead path): 1 in a column relative of NETWORK.csv, or
--relative for all. Those from one point share one unknown offset, or one in each segment (column segment, any name:
a beam that was not interrupted). --offsets writes them.

a point in the plane of the points that it is measured from: its height is determined to second order only, u is blank,
and a second solution on the other side is named. --trials N adjusts N networks drawn from the stated u (Monte Carlo):
u and 95 % intervals stand beside those of propagation, which is too small or one-sided there.

--residuals: for each distance its redundancy number r (0: nothing checks it, 1: fully checked), the minimal detectable
error sqrt(17.07) u/sqrt(r) (significance 0.1 %, power 80 %), and how far that error would move the point that it
moves most. --ellipsoids: semi-axes a, b, c of the standard error ellipsoids, their directions, and the factor to
the 95 % ellipsoid. Both are also in --json. What the distances do not determine is blank, in JSON null.

example:
  volid multilaterate distances.csv --approximate points.csv --robust -o adjusted.csv --residuals residuals.csv

exit status: 0 good; 1 written, but blunders, points that are not determined, second solutions that nothing decides, or a
rejected model are named; 2 bad input
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.epilog = _EPILOG
    parser.add_argument("network", metavar="NETWORK.csv", help="distances: from,to,distance,u")
    parser.add_argument(
        "--approximate", metavar="POINTS.csv", help="approximate or fixed coordinates: point,x,y,z,fixed"
    )
    parser.add_argument("-o", "--output", metavar="OUT.csv", help="adjusted coordinates; default: standard output")
    parser.add_argument(
        "--residuals", metavar="RES.csv", help="residuals, redundancy numbers, detectable errors, one row per distance"
    )
    parser.add_argument("--ellipsoids", metavar="ELL.csv", help="error ellipsoids, one row per unknown point")
    parser.add_argument(
        "--offsets", metavar="OFF.csv", help="offsets of relative distances: station,segment,offset,u,readings"
    )
    parser.add_argument(
        "--relative", action="store_true", help="all distances are relative: an unknown offset per point and segment"
    )
    parser.add_argument("--robust", action="store_true", help="find blunders, leave them out and name them")
    parser.add_argument("--dimension", type=int, choices=(2, 3), help="needed only without POINTS.csv; default 3")
    parser.add_argument(
        "--trials", type=count(2, MOST_TRIALS), metavar="N", help="Monte Carlo with N adjustments, such as 10000"
    )
    parser.add_argument("--seed", type=seed, default=0, metavar="N", help="of the trials; default 0")
    parser.add_argument("--json", action="store_true", help="everything as JSON on standard output")
    parser.add_argument("--force", action="store_true", help="overwrite existing files")


def run(args: argparse.Namespace) -> int:
    """Adjust, write, summarise; 1 when something needs attention. Raises `InputError`, `OutputError`."""
    _check_outputs(args)
    network = network_from_csv(args.network, args.approximate, args.dimension, args.relative)
    solution = network.adjust(robust=args.robust)
    spread, words = _monte_carlo(solution, args) if args.trials is not None else (None, [])
    _write_files(solution, spread, args)
    warnings, said = (
        [in_options(text, args) for text in texts] for texts in (attention(network, solution), notes(solution))
    )
    if args.json:
        print_json(as_objects(solution, warnings, said, spread, args.trials))
    elif not args.output:
        coordinates_csv(sys.stdout, solution, spread)
    if not args.json:
        print("\n".join(summary(solution) + words + said + warnings), file=sys.stdout if args.output else sys.stderr)
    return 1 if warnings else 0


def _check_outputs(args: argparse.Namespace) -> None:
    """Refuse now what could not be written later. Raises `OutputError`, also for one file that is to hold two results."""
    outputs = [path for path in (args.output, args.residuals, args.ellipsoids, args.offsets) if path]
    inputs = [path for path in (args.network, args.approximate) if path]
    for i, path in enumerate(outputs):
        if os.path.realpath(path) in map(os.path.realpath, outputs[:i]):
            raise OutputError(f"{path} is named for two results; name a file for each")
        check_output(path, args.force, inputs)


def _write_files(solution: NetworkSolution, spread: Spread | None, args: argparse.Namespace) -> None:
    """Every file that was asked for."""
    if args.output:
        write_coordinates(args.output, solution, args.force, spread)
    for path, write in (
        (args.residuals, write_residuals),
        (args.ellipsoids, write_ellipsoids),
        (args.offsets, write_offsets),
    ):
        if path:
            write(path, solution, args.force)


def _monte_carlo(solution: NetworkSolution, args: argparse.Namespace) -> tuple[Spread, list[str]]:
    """Spread of the coordinates over the trials, and where propagation would not have been enough, in words."""
    from volid.uncertainty.coverage import coverage_intervals, gum_validity

    trials = network_trials(solution, args.trials, args.seed)
    samples = trials.coordinates[trials.converged].reshape(int(trials.converged.sum()), -1)
    try:
        found = coverage_intervals(samples)
    except InputError as error:
        raise InputError(f"--trials {args.trials}: {error}") from None
    shape, u = solution.coordinates.shape, solution.standard_uncertainty.ravel()
    checked = gum_validity(solution.coordinates.ravel(), u, found, len(samples))
    names = np.array([f"{axis} of {name}" for name in solution.points for axis in "xyz"[: shape[1]]])
    wrong = names[(u > 0.0) & ~checked.valid & checked.decided].tolist()
    failed = int((~trials.converged).sum())
    spread = Spread(samples.std(axis=0, ddof=1).reshape(shape), *(f.reshape(shape) for f in found[:2]))
    blank = names[np.isnan(u)].tolist()
    return spread, _trial_words(len(samples), wrong, blank, failed)


def _trial_words(adjustments: int, wrong: list[str], blank: list[str], failed: int) -> list[str]:
    """What Monte Carlo says of propagation.

    `wrong`: coordinates for which it misleads; `blank`: those that have no u from it; `failed`: trials left out.
    """
    verdict = f"propagation would have been enough for all {'other ' if blank else ''}coordinates."
    if wrong:
        verdict = f"propagation misleads (JCGM 101, 8) for {_first(wrong)}: take u_mc."
    if blank:
        verdict = f"propagation has no u for {_first(blank)}: take u_mc; " + verdict
    words = [f"Monte Carlo: {adjustments} adjustments; {verdict}"]
    if failed:
        words.append(f"{failed} of {adjustments + failed} trials did not converge and are left out.")
    return words


def _first(names: list[str]) -> str:
    """The first names."""
    return ", ".join(names[:8]) + (", ..." if len(names) > 8 else "")
