"""Systematic effects of a set, and angles of its beams, as errors that readings share: for the u of what a standard computes."""

from __future__ import annotations

import numpy as np

from volid.campaign import Campaign, ObservationSet
from volid.effects import TYPES
from volid.effects.base import Sensitivity, Term
from volid.effects.prediction import is_random
from volid.model.jacobian import axis_rows
from volid.model.kinematics import nominal_rotation
from volid.observations.base import NuisanceTable
from volid.observations.beam_lines import BeamLine, beams_of

UNCHANGED = 1e-6  # mm or rad: a correction that is smaller is none


def corrections(observations: ObservationSet, rows: np.ndarray | slice = slice(None)) -> tuple[str, ...]:
    """What is to be said of the environment's corrections of readings.

    >>> import volid
    >>> campaign = volid.load_campaign("datasets/iso230_2_synthetic/campaign.toml")
    >>> corrections(campaign.sets[0])
    ()
    """
    if observations.as_read is None:
        return ()
    change = float(np.ptp((observations.readings - observations.as_read)[rows]))
    if change <= UNCHANGED:
        return ()
    return (
        f"the environment of the campaign corrected the readings, by up to {1e3 * change:.2f} µm against each other",
    )


def shared_columns(observations: ObservationSet, campaign: Campaign) -> np.ndarray:
    """Errors of one standard uncertainty that readings of a set share, one column for each scope of each effect, (m, k).

    The covariance of the readings (the first of each row) is diag(u²) + C Cᵀ with these columns C where no effect is drawn
    anew for every reading (`own_variance`). Errors of the tool vector, which move all readings of a line alike, are left out.
    """
    table, terms = NuisanceTable(), []
    for effect in observations.effects:
        if not is_random(effect):
            terms += TYPES[effect.type].terms(effect, observations, campaign, table)
    columns = [_column(term, i) * entry.prior_u for i, entry in enumerate(table.entries) for term in terms]
    angle = float(observations.options.get("misalignment_u", np.inf))
    if observations.options.get("misalignment", False) and np.isfinite(angle):
        columns += [angle * column for line in beams_of(observations, campaign) for column in tilt_columns(line).T]
    columns = [c for c in columns if c.any()]
    return np.stack(columns, axis=1) if columns else np.zeros((len(observations), 0))


def own_variance(observations: ObservationSet, campaign: Campaign) -> np.ndarray:
    """Variance of each reading by itself, (m,) [mm²]: u², and effects that are drawn anew for every reading.

    Those of axes and tool act through the nominal machine along the beam.
    """
    found = observations.u[:, 0] ** 2
    effects = [e for e in observations.effects if is_random(e)]
    if not effects:
        return np.asarray(found)
    machine, m = campaign.machine, len(observations)
    along = np.zeros((m, 3))
    for line in beams_of(observations, campaign):
        along[line.rows] = line.beam.along
    moved = axis_rows(machine, observations.positions, observations.tool)[:, :3]
    by_tool = np.einsum("mij,mi->jm", nominal_rotation(machine, observations.positions, len(machine.axes), 0), along)
    sensitivity = Sensitivity(np.einsum("mij,mi->jm", moved, along)[:, :, None], by_tool[:, :, None])
    for effect in effects:
        found = found + TYPES[effect.type].variance(effect, observations, machine, sensitivity)[:, 0]
    return np.asarray(found)


def _column(term: Term, number: int) -> np.ndarray:
    return np.where(term.slot == number, term.factor[:, 0], 0.0)


def tilt_columns(line: BeamLine) -> np.ndarray:
    """What 1 rad of tilt of the mirror against its line, about each of two directions, adds to readings of the set, (m, 2) [mm].

    At Δ beside the beam a tilt adds its part along Δ. A beam that is turned together with its mirror does the same.
    """
    found = np.zeros((len(line.observations), 2))
    found[line.rows] = (line.places - line.point) @ line.frame[1:].T
    return found
