"""The statement of uncertainty: headline outputs with u by propagation and by Monte Carlo, intervals, and how they agree."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np

from volid.fitting.prediction.spread import linear_uncertainty
from volid.fitting.solution import Solution
from volid.model.axis_lines import AXIS_LINE, is_of_a_line
from volid.uncertainty.coverage import PROBABILITY, Intervals, coverage_intervals, gum_validity
from volid.uncertainty.lack_of_fit import LackOfFit, lack_of_fit
from volid.uncertainty.outputs import FIELD, Outputs, headline_outputs
from volid.uncertainty.trials.samples import Samples


class Row(NamedTuple):
    """One output; lengths [mm], rotations [rad], positions [mm or degrees].

    `u`: by propagation (NaN for outputs that are not linear), `u_mc`: by Monte Carlo, `U` = 2 u_mc (k = 2); `low` …
    `shortest_high`: 95 % intervals; `valid`: propagation would have been enough (JCGM 101, 8; one significant digit); `decided`:
    enough trials to tell.
    """

    name: str
    unit: str
    position: float
    value: float
    u: float
    u_mc: float
    U: float
    low: float
    high: float
    shortest_low: float
    shortest_high: float
    valid: bool
    decided: bool


class Statement(NamedTuple):
    """`rows`: outputs in the order of `headline_outputs`; `trials`, those `failed` (not converged) and `solved` by the full
    solver; `tolerance`: see `Samples`; `lack_of_fit`: what stands beside u."""

    rows: tuple[Row, ...]
    trials: int
    failed: int
    solved: int
    tolerance: float
    lack_of_fit: LackOfFit


def statement(solution: Solution, tool: np.ndarray | None = None, outputs: Outputs | None = None) -> Statement:
    """Evaluate the samples of a solution. Raises `ValueError` when there are none, or fewer than an interval needs."""
    samples = solution.samples
    if samples is None:
        raise ValueError("the solution has no Monte Carlo samples")
    outputs = headline_outputs(solution, tool) if outputs is None else outputs
    centre = np.concatenate([np.asarray(solution.parameters), np.asarray(solution.nuisance)])
    estimate = outputs.values(centre[None])[0]
    u = np.full(len(estimate), np.nan)
    u[: len(outputs.rows)] = np.hypot(
        linear_uncertainty(outputs.rows, np.asarray(solution.covariance)), outputs.scatter
    )
    found, spread, converged = _sampled(samples, outputs)
    checked = gum_validity(estimate, np.where(np.isnan(u), spread, u), found, converged)
    rows = tuple(
        Row(*row)
        for row in zip(
            outputs.names, outputs.units, outputs.positions.tolist(), estimate.tolist(), u.tolist(), spread.tolist(),
            (2.0 * spread).tolist(),
            *(c.tolist() for c in found), checked.valid.tolist(), checked.decided.tolist(), strict=True,
        )
    )  # fmt: skip
    failed = samples.trials - converged
    return Statement(rows, samples.trials, failed, int(samples.solved.sum()), samples.tolerance, lack_of_fit(solution))


def _sampled(samples: Samples, outputs: Outputs) -> tuple[Intervals, np.ndarray, int]:
    """Intervals and standard deviations of all outputs (q,), and the number of trials behind them; few outputs at a time."""
    parts, spreads, converged = [], [], 0
    for values in _groups(samples, outputs):
        parts.append(coverage_intervals(values))
        spreads.append(values.std(axis=0, ddof=1))
        converged = len(values)
    return Intervals(*(np.concatenate(ends) for ends in zip(*parts, strict=True))), np.concatenate(spreads), converged


def _groups(samples: Samples, outputs: Outputs) -> Iterator[np.ndarray]:
    """Samples (M', q) of the linear outputs, then of the others, one group in memory at a time."""
    rng = np.random.default_rng([samples.seed, 2])
    for part, values in samples.linear(outputs.rows):
        own = outputs.scatter[part]
        yield values + own * rng.standard_normal(values.shape) if np.any(own > 0.0) else values
    yield samples.outputs(lambda x: outputs.field_values(x, rng))


def format_statement(found: Statement) -> str:
    """The statement as text: constants and the working volume one by one, error motions at their worst place."""
    worst: dict[str, Row] = {}
    for row in found.rows:
        if row.name not in worst or row.u_mc > worst[row.name].u_mc:
            worst[row.name] = row
    lines = [
        f"Monte Carlo: {found.trials} refits{_how(found)}; {PROBABILITY:.0%} coverage intervals",
        "",
        f"{'':20s} {'value':>9s} {'u':>8s} {'u (MC)':>8s} {'U (k=2)':>8s}   {'symmetric':^19s}   {'shortest':^19s}",
        *map(_line, worst.values()),
        *([f"location errors: {AXIS_LINE}"] if any(map(is_of_a_line, worst)) else []),
        "",
        _validity(found),
        f"lack of fit: {found.lack_of_fit}",
    ]
    return "\n".join(lines)


def _line(row: Row) -> str:
    """One output in µm or µrad, with its intervals, and whether propagation gives another one."""
    where = "" if np.isnan(row.position) else f" at {row.position:g}"
    scale, unit = (1e6, "µrad") if row.unit == "rad" else (1e3, "µm")
    numbers = [scale * v for v in row[3:11]]
    u = f"{numbers[1]:8.3f}" if np.isfinite(numbers[1]) else f"{'–':>8s}"
    mark = "" if row.valid or not row.decided or row.name in FIELD else "   propagation differs"
    return (
        f"{row.name + where:20s} {numbers[0]:9.3f} {u} {numbers[2]:8.3f} {numbers[3]:8.3f}   "
        f"{numbers[4]:9.3f} …{numbers[5]:9.3f}   {numbers[6]:9.3f} …{numbers[7]:9.3f} {unit}{mark}"
    )


def _validity(found: Statement) -> str:
    """For how many outputs propagation would have been enough."""
    linear = [row for row in found.rows if np.isfinite(row.u)]
    decided = [row for row in linear if row.decided]
    valid, open_ = sum(row.valid for row in decided), len(linear) - len(decided)
    text = f"propagation would have been enough (JCGM 101, 8) for {valid} of {len(decided)} outputs"
    return f"{text}; {open_} need more trials to decide" if open_ else text


def _how(found: Statement) -> str:
    parts = []
    if found.solved:
        parts.append(f"{found.solved} by the full solver")
    if found.failed:
        parts.append(f"{found.failed} did not converge and are left out")
    if np.isfinite(found.tolerance):
        parts.append(f"numerical tolerance {found.tolerance:.2f} of the wanted one")
    return f" ({', '.join(parts)})" if parts else ""


def as_data(found: Statement) -> dict[str, Any]:
    """The statement as plain data, for JSON."""
    return {
        **found._asdict(),
        "lack_of_fit": found.lack_of_fit._asdict(),
        "rows": [row._asdict() for row in found.rows],
    }
