"""A campaign against the nominal machine: how far readings are from a chain without errors, and which slip explains that.

Only what is unknown of the instruments (stations, dead paths, spheres, offsets) is adjusted, with one weight for all lengths.
What remains is about as large as the machine's errors: micrometres, or some millimetres on a large machine. A slip, such as two
exchanged columns, makes it a thousand times larger, and trying every slip takes a second. The adjustment does not see a mistake
that moves nothing nominally; the verdict on the whole model does (`diagnosis.alternatives.slips`).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from volid.campaign import Campaign, ObservationSet
from volid.exceptions import InputError, VolidError
from volid.fitting.equations.choice import engine_named
from volid.fitting.equations.problem import build_problem, nothing_known
from volid.fitting.equations.solver import solve
from volid.fitting.starts import find_starts
from volid.model.error_model import build_model
from volid.model.machine import FunctionSettings, Machine, ModelSettings
from volid.observations import KINDS
from volid.observations.base import DEGREES
from volid.plausibility.slips import NONE, STATIONS, Slip, slips, with_unknown_stations

ROWS = 600  # of a campaign that are adjusted
LARGE = 0.003  # of the extent of the positions: a misfit above is looked into; a large gantry has a third of it
LEAST = 2.0  # mm, however small the extent: lines of rotary axes may be stated as wrongly as that
BETTER = 0.1  # misfit without the slip over that with it, at most
SURE = 0.2  # the same for the second-best slip: where another explains it as well, both are named
PLACED = 0.05  # mm: a misfit above is looked into where stations are known
ANGLE = 1e-3  # rad that count as 1 mm


class Explained(NamedTuple):
    """A slip with the misfit that remains without it [mm]."""

    slip: Slip
    misfit: float


def few(campaign: Campaign, rows: int, used: list[np.ndarray] | None = None) -> Campaign:
    """Some of the rows, evenly over each set; `used` (m,) per set: those that may be taken."""
    share, sets = min(rows / max(sum(len(s) for s in campaign.sets), 1), 1.0), []
    for number, s in enumerate(campaign.sets):
        taken = np.arange(len(s)) if used is None else np.flatnonzero(used[number])
        count = max(int(share * len(taken)), min(len(taken), 2))
        if count:
            sets.append(s.rows_of(taken[np.unique(np.linspace(0, len(taken) - 1, count).astype(int))]))
    return replace(campaign, sets=tuple(sets))


def nominal_misfit(campaign: Campaign, scales: Mapping[str, float] = NONE) -> float:
    """Root mean square of reading - predicted on the machine without errors [mm], 1 mrad counting as 1 mm; infinite where nothing
    can be adjusted. `scales`: by how much the readings of a set, by its name, count less.

    >>> import volid
    >>> campaign = volid.load_campaign("datasets/vertical_multilateration/campaign.toml")
    >>> nominal_misfit(campaign) < 0.05  # mm, errors of some 10 µm
    True
    """
    plain = replace(
        campaign, machine=_without_errors(campaign.machine), sets=tuple(_evenly(s, scales) for s in campaign.sets)
    )
    try:
        model = build_model(plain.machine, {})
        starts, known, engine = find_starts(plain), nothing_known(model), engine_named("interpreted")
        problem = build_problem(plain, model, starts, known, engine=engine)
        with np.errstate(all="ignore"):
            cost = solve(problem, problem.start, problem.free).cost
    except (VolidError, np.linalg.LinAlgError):
        return float("inf")
    found = float(np.sqrt(2.0 * cost / max(campaign.n_readings, 1)))
    return found if np.isfinite(found) else float("inf")


def _without_errors(machine: Machine) -> Machine:
    return replace(machine, model=ModelSettings(functions={"*": FunctionSettings(use=False)}))


def _evenly(s: ObservationSet, scales: Mapping[str, float]) -> ObservationSet:
    """The set with a u of 1 mm, or of the angle that counts as 1 mm, times its scale, and without effects."""
    kind = KINDS[s.kind]
    scale = min(scales.get(s.name, 1.0), 1.0)  # smaller readings alone would leave less
    u = [np.rad2deg(ANGLE) if kind.unit_of(k) == DEGREES else 1.0 for k in range(len(kind.readings))]
    return replace(s, u=scale * np.tile(u, (len(s), 1)), effects=())


def extent(campaign: Campaign) -> float:
    """Diagonal of the box around all positions of the linear axes [mm]."""
    linear = [axis.is_linear for axis in campaign.machine.axes]
    return float(np.linalg.norm(np.ptp(campaign.positions[:, linear], axis=0)))


def explained(campaign: Campaign, misfit: float, better: float = BETTER) -> list[Explained]:
    """Slips without which the misfit [mm] is at most `better` times as large, the best first; in the size of the readings as they
    stand, since smaller readings would always leave less."""
    found: list[Explained] = []
    for slip in slips(campaign):
        if slip.cause == STATIONS and found:  # many labels could be exchanged: tried only where nothing else explains
            break
        remaining = nominal_misfit(few(slip.campaign, ROWS), slip.scales)
        if np.isfinite(remaining) and remaining <= better * misfit:
            found.append(Explained(slip, remaining))
    return sorted(found, key=lambda e: e.misfit)


def check_nominal(campaign: Campaign) -> None:
    """Raises `InputError` where readings and nominal chain disagree by much, and a slip explains it.

    Without an explanation the campaign passes: the verdict on the fit says then what is wrong.
    """
    thinned = few(campaign, ROWS)
    misfit = nominal_misfit(thinned)
    if not np.isfinite(misfit):  # what cannot be fitted is told by the fit
        return
    _check_known(thinned, misfit)
    if misfit <= max(LARGE * extent(thinned), LEAST):
        return
    found = explained(campaign, misfit)
    if not found:
        return
    likely = list(_as_likely(found))
    cure = f"What to do: {likely[0].cure}"
    if len(likely) > 1:
        cures = ", or ".join(s.cure.removeprefix("campaign: ") for s in likely)
        cure = f"The readings do not tell which: look at the machine, and then {cures}"
    said = " or ".join(slip.what for slip in likely)
    where = campaign.source or "campaign"
    raise InputError(
        f"{where}: it seems that {said}: the readings disagree with the nominal machine by {misfit:.3g} mm (root mean square), "
        f"but by {found[0].misfit:.2g} mm without that. {cure}; if the campaign is right as it stands, pass "
        "`accept_large_errors=True`"
    )


def _check_known(campaign: Campaign, misfit: float) -> None:
    """Raises `InputError` where stations are said to be known, and the readings agree ten times better if they are not.

    That takes less than a gross misfit: errors of the machine would remain with stations of unknown position as well.
    """
    if misfit < PLACED or not any(station.known for station in campaign.stations):
        return
    remaining = nominal_misfit(with_unknown_stations(campaign))
    if remaining <= BETTER * misfit:
        raise InputError(
            f"{campaign.source or 'campaign'}: stations are stated as known, but the readings disagree with their positions by "
            f"{misfit:.2g} mm (root mean square), and by {remaining:.2g} mm if they are unknown. What to do: [[station]] known = "
            "false, or mend the positions (mm, machine frame or a common one); if they are right, pass `accept_large_errors=True`"
        )


def _as_likely(found: list[Explained]) -> Iterator[Slip]:
    """The best slip in words, and those of another sort that the readings do not tell from it."""
    limit, seen = found[0].misfit / SURE, set()
    for e in found:
        if e.misfit <= limit and e.slip.cause not in seen:
            seen.add(e.slip.cause)
            yield e.slip
