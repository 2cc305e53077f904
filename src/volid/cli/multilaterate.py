"""`volid multilaterate`: coordinates of stations and targets from distances alone, free or with fixed points."""

from __future__ import annotations

import argparse
import json
import sys

import numpy as np

from volid.exceptions import InputError
from volid.io.networks import (
    Network,
    Spread,
    coordinates_csv,
    network_from_csv,
    write_coordinates,
    write_residuals,
)
from volid.multilateration import NetworkSolution, network_trials

HELP = "coordinates of a distance network, free or with fixed points, without a machine model"

_EPILOG = """\
NETWORK.csv has the columns from,to,distance,u; POINTS.csv has point,x,y,z,fixed (no z: a plane network; fixed: 0 or 1,
optional). One unit of length throughout. Without fixed points the result lies as near to POINTS.csv as the distances
allow (inner constraints); without POINTS.csv its frame is arbitrary, mirror image included.

--trials N adjusts N networks drawn from the stated u (Monte Carlo): u and 95 % intervals stand beside those of
propagation, which is too small or one-sided where a point lies near the plane of the stations that see it.

example:
  volid multilaterate distances.csv --approximate points.csv --robust -o adjusted.csv --residuals residuals.csv

exit status: 0 good; 1 written, but blunders, points that are not determined or a rejected model are
named; 2 bad input
"""
_REJECTED = 0.001  # probability of the sum of squared residuals below which model or u are called wrong


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.epilog = _EPILOG
    parser.add_argument("network", metavar="NETWORK.csv", help="distances: from,to,distance,u")
    parser.add_argument(
        "--approximate", metavar="POINTS.csv", help="approximate or fixed coordinates: point,x,y,z,fixed"
    )
    parser.add_argument("-o", "--output", metavar="OUT.csv", help="adjusted coordinates; default: standard output")
    parser.add_argument("--residuals", metavar="RES.csv", help="residuals, also normalised, one row per distance")
    parser.add_argument("--robust", action="store_true", help="find blunders, leave them out and name them")
    parser.add_argument("--dimension", type=int, choices=(2, 3), help="needed only without POINTS.csv; default 3")
    parser.add_argument("--trials", type=int, metavar="N", help="Monte Carlo with N adjustments, such as 10000")
    parser.add_argument("--seed", type=int, default=0, metavar="N", help="of the trials; default 0")
    parser.add_argument("--json", action="store_true", help="everything as JSON on standard output")
    parser.add_argument("--force", action="store_true", help="overwrite existing files")


def run(args: argparse.Namespace) -> int:
    """Adjust, write, summarise; 1 when something needs attention. Raises `InputError`, `OutputError`."""
    network = network_from_csv(args.network, args.approximate, args.dimension)
    solution = network.adjust(robust=args.robust)
    spread, words = _monte_carlo(solution, args) if args.trials is not None else (None, [])
    if args.output:
        write_coordinates(args.output, solution, args.force, spread)
    if args.residuals:
        write_residuals(args.residuals, solution, args.force)
    warnings = attention(network, solution)
    if args.json:
        found = as_json(solution, warnings)
        if spread is not None:
            found["monte_carlo"] = {"trials": args.trials, **{k: v.tolist() for k, v in spread._asdict().items()}}
        print(json.dumps(found, indent=1))
    elif not args.output:
        coordinates_csv(sys.stdout, solution, spread)
    if not args.json:
        print("\n".join(summary(solution) + words + warnings), file=sys.stdout if args.output else sys.stderr)
    return 1 if warnings else 0


def _monte_carlo(solution: NetworkSolution, args: argparse.Namespace) -> tuple[Spread, list[str]]:
    """Spread of the coordinates over the trials, and where propagation would not have been enough, in words."""
    from volid.uncertainty.coverage import coverage_intervals, gum_validity

    trials = network_trials(solution, args.trials, args.seed)
    samples = trials.coordinates[trials.converged].reshape(int(trials.converged.sum()), -1)
    try:
        found = coverage_intervals(samples)
    except ValueError as error:
        raise InputError(f"--trials {args.trials}: {error}") from None
    shape, u = solution.coordinates.shape, solution.standard_uncertainty.ravel()
    checked = gum_validity(solution.coordinates.ravel(), u, found, len(samples))
    names = np.array([f"{axis} of {name}" for name in solution.points for axis in "xyz"[: shape[1]]])
    wrong = names[(u > 0.0) & ~checked.valid & checked.decided].tolist()
    failed = int((~trials.converged).sum())
    spread = Spread(samples.std(axis=0, ddof=1).reshape(shape), *(f.reshape(shape) for f in found[:2]))
    return spread, _trial_words(len(samples), wrong, failed)


def _trial_words(adjustments: int, wrong: list[str], failed: int) -> list[str]:
    """What Monte Carlo says of propagation. `wrong`: coordinates for which it misleads; `failed`: trials left out."""
    verdict = "propagation would have been enough for all coordinates."
    if wrong:
        listed = ", ".join(wrong[:8]) + (", ..." if len(wrong) > 8 else "")
        verdict = f"propagation misleads (JCGM 101, 8) for {listed}: take u_mc."
    words = [f"Monte Carlo: {adjustments} adjustments; {verdict}"]
    if failed:
        words.append(f"{failed} of {adjustments + failed} trials did not converge and are left out.")
    return words


def summary(solution: NetworkSolution) -> list[str]:
    """The result in a few lines."""
    dimension = solution.coordinates.shape[1]
    free = len(solution.unknown)
    lines = [
        f"{len(solution.points)} points ({len(solution.points) - free} fixed), {len(solution.observations)} distances, "
        f"{dimension}-D: rank {solution.rank}, defect {solution.defect}, "
        f"{solution.degrees_of_freedom} degrees of freedom.",
    ]
    if solution.degrees_of_freedom > 0:
        lines.append(f"unit weight {solution.unit_weight:.3g}; 1 when the stated u is right.")
    else:
        lines.append("no redundancy: nothing checks the distances.")
    return lines


def attention(network: Network, solution: NetworkSolution) -> list[str]:
    """What needs attention, one message each; empty when all is well."""
    messages = [_named(network, solution, i, "left out as a blunder") for i in solution.blunders]
    messages += [_named(network, solution, i, "suspected blunder") for i in solution.suspects[:10]]
    if len(solution.suspects) > 10:
        messages.append(f"... and {len(solution.suspects) - 10} more suspected blunders.")
    if extra := solution.defect - solution.datum_defect:
        points = ", ".join(solution.undetermined)
        messages.append(
            f"The distances do not determine {extra} combinations of the coordinates of {points}; their u does "
            "not contain them. Measure these points from more places."
        )
    if solution.chi_square_probability < _REJECTED:
        messages.append(
            f"The distances contradict each other by more than the stated u (unit weight {solution.unit_weight:.3g}, "
            f"probability {solution.chi_square_probability:.1g}). Look for blunders (--robust), or state a larger u."
        )
    return messages


def _named(network: Network, solution: NetworkSolution, i: int, what: str) -> str:
    """One observation with its row, residual and those that it cannot be distinguished from."""
    start, end, distance = solution.observations[i]
    z = solution.normalised_residuals[i]
    size = "" if np.isnan(z) else f", {abs(z):.1f} of its standard deviations (critical {solution.critical_value:.1f})"
    where = f"row {network.rows[i]}, {start} to {end}, {distance:.12g}"
    text = f"{where}: {what}, residual {solution.residuals[i]:.4g}{size}."
    if others := solution.inseparable.get(i):
        rows = ", ".join(str(network.rows[j]) for j in others)
        text += f" A blunder in row {rows} would look the same."
    return text


def as_json(solution: NetworkSolution, warnings: list[str]) -> dict:
    """The solution as plain objects; NaN becomes null."""
    u = solution.standard_uncertainty
    return {
        "format": "volid-network/1",
        "points": [
            {"point": name, "coordinates": x.tolist(), "u": s.tolist(), "fixed": name not in solution.unknown}
            for name, x, s in zip(solution.points, solution.coordinates, u, strict=True)
        ],
        "observations": [
            {"from": start, "to": end, "distance": distance, "residual": float(r), "normalised_residual": _null(z)}
            for (start, end, distance), r, z in zip(
                solution.observations, solution.residuals, solution.normalised_residuals, strict=True
            )
        ],
        "rank": solution.rank,
        "defect": solution.defect,
        "datum_defect": solution.datum_defect,
        "undetermined": list(solution.undetermined),
        "degrees_of_freedom": solution.degrees_of_freedom,
        "unit_weight": _null(solution.unit_weight),
        "probability": _null(solution.chi_square_probability),
        "blunders": list(solution.blunders),
        "suspects": list(solution.suspects),
        "inseparable": {str(i): list(others) for i, others in solution.inseparable.items()},
        "attention": warnings,
    }


def _null(value: float) -> float | None:
    """None for NaN, which JSON has not."""
    return None if np.isnan(value) else float(value)
