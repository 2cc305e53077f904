"""An adjusted distance network in words and as plain objects: what needs attention, and what is worth knowing."""

from __future__ import annotations

import numpy as np

from volid.io.network_results import Spread
from volid.io.networks import Network
from volid.multilateration import Alternative, NetworkSolution

_REJECTED = (
    0.001  # probability of the sum of squared residuals, so large or so small, below which model or u are called wrong
)
_FAR_BELOW, _OTHER_UNIT = 0.5, 0.05  # unit weights below which u is called too large, and thought to be in another unit
_FEW = 3  # degrees of freedom below which good agreement says nothing
_MOST = 8  # messages of one kind, and names in one
_NO_DIFFERENCE = 0.005  # of chi-square


def summary(solution: NetworkSolution) -> list[str]:
    """The result in a few lines."""
    dimension = solution.coordinates.shape[1]
    free = len(solution.unknown)
    offsets = f", {len(solution.offsets)} offsets" if solution.offsets else ""
    lines = [
        f"{len(solution.points)} points ({len(solution.points) - free} fixed), {len(solution.observations)} distances{offsets}, "
        f"{dimension}-D: rank {solution.rank}, defect {solution.defect}, "
        f"{solution.degrees_of_freedom} degrees of freedom.",
    ]
    if solution.degrees_of_freedom > 0:
        lines.append(f"unit weight {solution.unit_weight:.3g}; 1 when the stated u is right.")
    else:
        lines.append("no redundancy: nothing checks the distances.")
    return lines


def notes(solution: NetworkSolution) -> list[str]:
    """What is worth knowing although it needs no attention."""
    said = []
    if solution.left_start:
        said.append(
            "note: the approximate coordinates alone lead to a worse minimum, or to none; another start (from the "
            "distances, or around the given one) led to this one."
        )
    decided = [
        f"note: {_second(one)}; the approximate coordinates are nearer the solution."
        for one in solution.alternatives
        if one.decided
    ]
    return said + _shortened(decided, "more second solutions")


def attention(network: Network, solution: NetworkSolution) -> list[str]:
    """What needs attention, one message each; empty when all is well."""
    messages = [_named(network, solution, i, "left out as a blunder") for i in solution.blunders]
    suspects = [_named(network, solution, i, "suspected blunder") for i in solution.suspects]
    messages += _shortened(suspects, "more suspected blunders")
    messages += _unconnected(solution) + _not_determined(solution)
    undecided = [
        f"{_second(one)}. Nothing tells which is right: state approximate coordinates on one side, or measure from elsewhere."
        for one in solution.alternatives
        if not one.decided
    ]
    return messages + _shortened(undecided, "more second solutions") + _unlikely(solution)


def _shortened(messages: list[str], what: str) -> list[str]:
    return messages[:_MOST] + ([f"... and {len(messages) - _MOST} {what}."] if len(messages) > _MOST else [])


def _second(one: Alternative) -> str:
    """A second solution in words."""
    rounding = 1e-12 * np.abs(one.coordinates).max()
    rows = np.where(np.abs(one.coordinates) < rounding, 0.0, one.coordinates)
    named = [f"{name} at ({', '.join(f'{v:.7g}' for v in x)})" for name, x in zip(one.points, rows, strict=True)]
    if abs(one.worse) < _NO_DIFFERENCE:
        return f"The distances fit as well with {_listed(named)}"
    size = f"{'larger' if one.worse > 0 else 'smaller'} by {abs(one.worse):.2g}"
    return f"The distances fit nearly as well, chi-square {size}, with {_listed(named)}"


def _unconnected(solution: NetworkSolution) -> list[str]:
    """The parts of a network without a common point."""
    if not solution.parts:
        return []
    parts = "; ".join(_listed(part) for part in solution.parts)
    return [
        f"The network falls into {len(solution.parts)} parts without a common point ({parts}): nothing tells how they lie to "
        "each other. Measure between them, or adjust each by itself."
    ]


def _not_determined(solution: NetworkSolution) -> list[str]:
    """Coordinates without u, and why; offsets likewise."""
    first = [name for name in solution.undetermined if name not in solution.second_order]
    messages = []
    extra = solution.defect - solution.datum_defect
    motions = "motion" if solution.datum_defect == 1 else "motions"
    if solution.datum_defect and len(solution.unknown) < len(solution.points):
        messages.append(
            f"The fixed points leave {solution.datum_defect} {motions} of the whole network open; it lies as near to the "
            "approximate coordinates as the distances allow, and u is blank where that moves a coordinate. Fix more points."
        )
    if first and not extra:
        messages.append(
            f"Nothing but the choice of the frame holds {_coordinates(solution, first)}: u is blank. Fix more points, "
            "or measure more."
        )
    elif first:
        messages.append(
            f"The distances do not determine {extra} combinations of the coordinates of {', '.join(first)}: u is blank for "
            f"{_coordinates(solution, first)}. Measure these points from more places."
        )
    if solution.second_order:
        shape = "plane" if solution.coordinates.shape[1] == 3 else "line"
        messages.append(
            f"The distances do not determine {_coordinates(solution, solution.second_order)} to first order, only by its square: "
            f"in the {shape} of the points that a point is measured from, or nearer to it than u, height moves no distance. "
            "The coordinates are at the minimum, u is blank; Monte Carlo (`trials=10000`) gives intervals. Measure from outside."
        )
    if open_offsets := [group for group, offset in solution.offsets.items() if np.isnan(offset.u)]:
        named = ", ".join(f"{station} segment {segment}" if segment else station for station, segment in open_offsets)
        messages.append(
            f"The distances do not determine the offset of {named}: its u is blank. Measure more points in that segment."
        )
    return messages


def _coordinates(solution: NetworkSolution, names: list[str] | tuple[str, ...]) -> str:
    """ "x and y of Q, z of S, T"."""
    of_axes: dict[str, list[str]] = {}
    for name in names:
        lost = solution.not_determined[solution.points.index(name)]
        axes = " and ".join(axis for axis, is_lost in zip("xyz", lost, strict=False) if is_lost)
        of_axes.setdefault(axes, []).append(name)
    return "; ".join(f"{axes} of {_listed(members)}" for axes, members in of_axes.items())


def _listed(names: list[str] | tuple[str, ...]) -> str:
    return ", ".join(names[:_MOST]) + (f" ... ({len(names)})" if len(names) > _MOST else "")


def _unlikely(solution: NetworkSolution) -> list[str]:
    """A sum of squared residuals that is too large or too small for the stated u."""
    weight = solution.unit_weight
    if solution.chi_square_probability < _REJECTED:
        return [
            f"The distances contradict each other by more than the stated u (unit weight {weight:.3g}, "
            f"probability {solution.chi_square_probability:.1g}). Look for blunders (`robust=True`), or state a larger u."
        ]
    small = solution.agreement_probability < _REJECTED and solution.degrees_of_freedom >= _FEW
    if not small or weight > _FAR_BELOW:
        return []
    unit = " Is u in another unit than the distances, such as mm for m?" if weight < _OTHER_UNIT else ""
    return [
        f"The distances agree far better than the stated u (unit weight {weight:.3g}, "
        f"probability {solution.agreement_probability:.1g}): u is too large, and with it the u of the coordinates.{unit}"
    ]


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


def as_objects(
    solution: NetworkSolution, warnings: list[str], said: list[str], spread: Spread | None, trials: int | None
) -> dict:
    """The solution as plain objects; what is not determined is NaN, null in JSON."""
    found = {
        "format": "volid-network/1",
        "points": _points(solution),
        "observations": _observations(solution),
        "offsets": [
            {
                "station": group[0],
                "segment": group[1],
                "offset": offset.value,
                "u": offset.u,
                "readings": offset.readings,
            }
            for group, offset in solution.offsets.items()
        ],
        "rank": solution.rank,
        "defect": solution.defect,
        "datum_defect": solution.datum_defect,
        "undetermined": list(solution.undetermined),
        "second_order": list(solution.second_order),
        "alternatives": [
            {
                "points": list(one.points),
                "coordinates": one.coordinates.tolist(),
                "chi_square_difference": one.worse,
                "decided": one.decided,
            }
            for one in solution.alternatives
        ],
        "parts": [list(part) for part in solution.parts],
        "degrees_of_freedom": solution.degrees_of_freedom,
        "unit_weight": solution.unit_weight,
        "probability": solution.chi_square_probability,
        "agreement_probability": solution.agreement_probability,
        "blunders": list(solution.blunders),
        "suspects": list(solution.suspects),
        "inseparable": {str(i): list(others) for i, others in solution.inseparable.items()},
        "attention": warnings,
        "notes": said,
    }
    if spread is not None:
        found["monte_carlo"] = {"trials": trials, **{k: v.tolist() for k, v in spread._asdict().items()}}
    return found


def _points(solution: NetworkSolution) -> list[dict]:
    """Coordinates, u and error ellipsoid of every point."""
    u, ellipsoids = solution.standard_uncertainty, solution.ellipsoids
    return [
        {
            "point": name,
            "coordinates": solution.coordinates[i].tolist(),
            "u": u[i].tolist(),
            "fixed": name not in solution.unknown,
            "ellipsoid": {
                "semi_axes": ellipsoids.axes[i].tolist(),
                "directions": ellipsoids.directions[i].tolist(),
                "scale_95": ellipsoids.scale,
            },
        }
        for i, name in enumerate(solution.points)
    ]


def _observations(solution: NetworkSolution) -> list[dict]:
    """Residuals and reliability of every observation."""
    check = solution.reliability
    return [
        {
            "from": start,
            "to": end,
            "distance": distance,
            "residual": solution.residuals[i],
            "normalised_residual": solution.normalised_residuals[i],
            "redundancy": check.redundancy[i],
            "detectable_error": check.detectable[i],
            "influence": check.influence[i],
            "influenced_point": solution.points[check.influenced[i]] if check.influenced[i] >= 0 else None,
        }
        for i, (start, end, distance) in enumerate(solution.observations)
    ]
