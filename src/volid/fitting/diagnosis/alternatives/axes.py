"""Alternatives in the chain: another order or side of the axes, an axis that counts the other way, two exchanged columns.

Each is the same campaign on another machine. Some of its readings are fitted on both, so that their chi-squares can be compared;
where the order or side changes, positions are nominally the same, and one step from the solution is enough.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import combinations
from typing import NamedTuple

import numpy as np

from volid.campaign import Campaign
from volid.exceptions import VolidError
from volid.fitting.diagnosis.alternatives.base import Alternative, Judged, profile
from volid.fitting.diagnosis.around import Fit
from volid.fitting.equations.choice import engine_named
from volid.fitting.equations.problem import Prior, Problem, build_problem
from volid.fitting.equations.solver import solve
from volid.fitting.starts import find_starts
from volid.model.error_model import ErrorModel, build_model
from volid.model.machine import Axis, Machine, parse_structure
from volid.observations.base import NuisanceTable

ORDER, SENSE, COLUMNS = "order or side of the axes", "sense of an axis", "exchanged columns"
ROWS, GROSS_ROWS = 4000, 1200  # of a campaign that are compared, the second where all of them are off by much
GROSS = 5.0  # unit weight from which on readings may be of another nominal machine altogether
RIDGE = 1e-10  # of scaled normal equations, for what the readings leave open


class Other(NamedTuple):
    """Another chain: cause, itself and its cure in words, machine, columns of positions and their signs, and whether positions
    are nominally elsewhere."""

    cause: str
    what: str
    cure: str
    machine: Machine
    columns: list[int]
    signs: np.ndarray
    elsewhere: bool = False


def other_chains(machine: Machine, gross: bool) -> Iterator[Other]:
    """Every single mistake; those that put positions elsewhere only when the misfit is `gross`."""
    ones = np.ones(len(machine.axes))
    for codes in other_structures(machine.structure):
        changed = _restructured(machine, codes[0])
        columns = [machine.index(letter) for letter in changed.letters]
        order, now = ", ".join(changed.letters), ", ".join(machine.letters)
        what = f"the axes stand in the order {order} from workpiece to tool, not {now}"
        others = f" (or, with b elsewhere, {', '.join(codes[1:])})"
        yield Other(ORDER, what, f'machine file: structure = "{codes[0]}"{others}', changed, columns, ones)
    if not gross:
        return
    same = list(range(len(machine.axes)))
    for i, axis in enumerate(machine.axes):
        yield _other_sense(machine, i, axis)
    linear = [i for i, axis in enumerate(machine.axes) if axis.is_linear]
    rotary = [i for i, axis in enumerate(machine.axes) if not axis.is_linear]
    for i, j in (*combinations(linear, 2), *combinations(rotary, 2)):
        swapped = [j if k == i else i if k == j else k for k in same]
        a, b = machine.letters[i], machine.letters[j]
        yield Other(
            COLUMNS,
            f"positions of {a} and {b} are exchanged",
            f"campaign: exchange columns {a} and {b}",
            machine,
            swapped,
            ones,
            True,
        )


def _other_sense(machine: Machine, i: int, axis: Axis) -> Other:
    signs = np.ones(len(machine.axes))
    same = list(range(len(machine.axes)))
    if axis.is_linear:
        signs[i] = -1.0
        cure = f"campaign: negate column {axis.letter}"
        return Other(SENSE, f"axis {axis.letter} counts the other way", cure, machine, same, signs, True)
    x, y, z = (0.0 - c for c in axis.unit_vector)
    axes = tuple(replace(a, direction=(x, y, z)) if k == i else a for k, a in enumerate(machine.axes))
    cure = f"machine file, [axis.{axis.letter}]: direction = [{x:g}, {y:g}, {z:g}]"
    return Other(
        SENSE, f"axis {axis.letter} counts the other way", cure, replace(machine, axes=axes), same, signs, True
    )


def _plain(structure: str) -> str:
    return structure.strip().removeprefix("[").removesuffix("]").strip()


def other_structures(structure: str) -> Iterator[list[str]]:
    """Structural codes with one axis at another place of the chain, or two exchanged, in groups of one order of the letters.

    Codes with one order of the letters have the same error motions, whichever side of the bed an axis stands on: nothing tells
    them apart. The first code of a group has the fewest axes on the other side.

    >>> list(other_structures("w X' b Y t"))
    [['w b Y X t', "w Y' X' b t", "w Y' b X t"]]
    """
    tokens = _plain(structure).split()
    bed = tokens.index("b")
    spindle = [t for t in tokens if t.startswith("(")]
    axes = [t for t in tokens[1:-1] if t != "b" and not t.startswith("(")]
    primed, seen = {t[0] for t in tokens[1:bed]}, {tuple(t[0] for t in axes)}
    for order in _orders([t[0] for t in axes]):
        if order not in seen:
            seen.add(order)
            yield [_code(order, k, spindle) for k in _beds(order, primed)]


def _beds(order: tuple[str, ...], primed: set[str]) -> list[int]:
    """How many axes may carry the workpiece, those numbers first for which the fewest axes change their side."""
    return sorted(range(len(order) + 1), key=lambda k: sum((a in primed) != (i < k) for i, a in enumerate(order)))


def _code(order: tuple[str, ...], count: int, spindle: list[str]) -> str:
    return " ".join(["w", *(f"{a}'" for a in order[:count]), "b", *order[count:], *spindle, "t"])


def _orders(letters: list[str]) -> Iterator[tuple[str, ...]]:
    """Two axes exchanged, neighbours first; then one axis moved."""
    n = len(letters)
    for gap in range(1, n):
        for i in range(n - gap):
            order = letters.copy()
            order[i], order[i + gap] = order[i + gap], order[i]
            yield tuple(order)
    for i in range(n):
        rest = letters[:i] + letters[i + 1 :]
        for j in range(n):
            yield (*rest[:j], letters[i], *rest[j:])


def _restructured(machine: Machine, structure: str) -> Machine:
    sides = parse_structure(structure)
    axes = tuple(replace(machine.axis(letter), primed=primed) for letter, primed in sides)
    return replace(machine, structure=structure, axes=axes)


def judged_chains(fit: Fit, machine: Machine, chi_square: float, freedom: int, share: float) -> Iterator[Judged]:
    """Other chains with what they gain, in all readings and as `share` of them would show it.

    `machine`: with travels cut to what was measured. Both machines have as many unknowns, so that the difference of -2 log
    likelihood needs no allowance; that chance makes it as large as g has a probability below exp(-g/2) (Markov's inequality for
    the likelihood ratio; Royall 2000).
    """
    gross = chi_square > GROSS**2 * max(freedom, 1)
    campaign = _few(fit.campaign, fit.factors, GROSS_ROWS if gross else ROWS)
    same = Other("", "", "", machine, list(range(len(machine.axes))), np.ones(len(machine.axes)), gross)
    own = campaign.n_readings / fit.campaign.n_readings
    scale = share / (fit.share * own)
    now = min(_chi_square(fit, campaign, same), _chi_square(fit, campaign, same._replace(elsewhere=False)))
    if not np.isfinite(now):
        return
    others = list(other_chains(machine, gross))
    nu = int(fit.share * own * freedom)
    for other in others:
        found = _chi_square(fit, campaign, other)
        if not np.isfinite(found):
            continue
        gain = scale * max(profile(now, nu) - profile(found, nu), 0.0)
        nothing = np.zeros((fit.campaign.n_readings, 0))
        alternative = Alternative(other.cause, other.what, other.cure, nothing, tried=float(len(others)))
        chance, beyond = min(-0.5 * gain + float(np.log(len(others))), 0.0), np.full(1, np.inf)
        yield Judged(alternative, scale * (now - found), gain, 0, chance, np.zeros(0), beyond)


def _few(campaign: Campaign, factors: list[np.ndarray], rows: int) -> Campaign:
    """Some of the rows that take part, evenly over each set."""
    share, sets = min(rows / max(sum(len(s) for s in campaign.sets), 1), 1.0), []
    for s, f in zip(campaign.sets, factors, strict=True):
        used = np.flatnonzero(np.all(f > 0.0, axis=1))
        count = max(int(share * len(used)), min(len(used), 2))
        if count:
            sets.append(s.rows_of(used[np.unique(np.linspace(0, len(used) - 1, count).astype(int))]))
    return replace(campaign, sets=tuple(sets))


def _chi_square(fit: Fit, campaign: Campaign, other: Other) -> float:
    """Chi-square of the campaign on another machine; infinite where it cannot be fitted."""
    sets = tuple(
        s.moved(lambda q: (q * other.signs)[:, other.columns], lambda way: way[:, other.columns]) for s in campaign.sets
    )
    machine = other.machine if not other.elsewhere else _covering(other.machine, sets)
    moved = replace(campaign, machine=machine, sets=sets)
    try:
        problem, start = _problem(fit, moved, other.elsewhere)
        if other.elsewhere:
            return 2.0 * solve(problem, start, problem.free).cost
        return _one_step(problem, start)
    except (VolidError, np.linalg.LinAlgError):
        return float("inf")


def _covering(machine: Machine, sets: tuple) -> Machine:  # type: ignore[type-arg]
    """The machine with travels that hold all positions."""
    positions = np.concatenate([s.all_ends.positions for s in sets])
    ends = {
        a.letter: (min(a.travel[0], float(low)), max(a.travel[1], float(high)))
        for a, low, high in zip(machine.axes, positions.min(axis=0), positions.max(axis=0), strict=True)
    }
    return machine.over(ends)


def _problem(fit: Fit, campaign: Campaign, elsewhere: bool) -> tuple[Problem, np.ndarray]:
    """The problem on the campaign's machine, with functions as smooth as those of the fit, and where to start."""
    own = fit.problem.model
    model = build_model(campaign.machine, own.segments)
    place = _same_parameters(model, own)
    rows = fit.smooth_rows
    known = np.zeros((len(rows), model.n_parameters))
    known[:, place[:, 0]] = rows[:, place[:, 1]]
    prior = Prior(np.zeros(len(rows)), known)
    table = NuisanceTable(find_starts(campaign) if elsewhere else {**fit.starts, **_values(fit)})
    problem = build_problem(campaign, model, prior=prior, table=table, engine=engine_named("interpreted"))
    start = problem.start.copy()
    if not elsewhere:
        theta = np.zeros(model.n_parameters)
        theta[place[:, 0]] = (own.projection @ fit.z[: own.layout.n_coefficients])[place[:, 1]]
        start[: model.layout.n_coefficients] = model.parametrisation @ theta
    return problem, start


def _values(fit: Fit) -> dict[object, float]:
    """Values of the unknowns beside the functions, by key; what is known beforehand keeps its start."""
    values = fit.z[fit.problem.model.layout.n_coefficients :].tolist()
    pairs = zip(fit.problem.nuisance, values, strict=True)
    return {entry.key: value for entry, value in pairs if np.isinf(entry.prior_u)}


def _same_parameters(model: ErrorModel, own: ErrorModel) -> np.ndarray:
    """Numbers of parameters that both models have, (k, 2): in `model` and in `own`."""
    pairs = []
    for key, function in model.by_name.items():
        if key in own.by_name:
            a, b = function.parameters, own.by_name[key].parameters
            if a.stop - a.start == b.stop - b.start:
                pairs += list(zip(range(a.start, a.stop), range(b.start, b.stop), strict=True))
    return np.unique(np.array(pairs, dtype=int).reshape(-1, 2), axis=0)


def _one_step(problem: Problem, z: np.ndarray) -> float:
    """Chi-square after one Gauss-Newton step, by the quadratic model of the cost."""
    normal = problem.equations.normal(z)
    matrix, gradient = problem.free.T @ normal.matrix @ problem.free, problem.free.T @ normal.gradient
    scale = 1.0 / np.sqrt(np.maximum(np.diagonal(matrix), 1e-300))
    scaled = matrix * scale[:, None] * scale
    scaled[np.diag_indices(len(scaled))] += RIDGE
    half = np.linalg.solve(np.linalg.cholesky(scaled), scale * gradient)
    return 2.0 * float(normal.cost) - float(half @ half)
