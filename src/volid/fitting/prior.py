"""An earlier solution as prior knowledge: linear axes measured before the rotary ones (ISO/TR 16907 10.3).

Functions that both models hold get what the earlier readings say of them as pseudo-readings W θ = t: with C the earlier
covariance on what the earlier data determined and Q what was assumed of the smoothness, WᵀW = C⁻¹ - Q and Wᵀt = C⁻¹ θ0. The
smoothness is not counted twice: it is estimated anew from both. To first order this equals a joint fit of both campaigns
(recursive least squares; Koch, Parameter Estimation, 3.3).
"""

from __future__ import annotations

import numpy as np

from volid.campaign import Campaign
from volid.exceptions import InputError
from volid.fitting.datum import s_transformation
from volid.fitting.diagnosis.identifiability import parameter_units
from volid.fitting.equations.problem import Prior
from volid.fitting.solution import Solution
from volid.model.error_functions import motion_names, settings_for
from volid.model.error_model import ErrorModel, build_model
from volid.model.iso230 import SPINDLE, parse
from volid.model.linear_maps import function_rows
from volid.model.machine import Machine
from volid.plausibility.conditions import active_compensations

EXACT = 1e-12  # eigenvalues of the scaled covariance below this share of the largest carry no information
ROUNDING = 1e-10  # share of the readings in what is known of a combination, beside the smoothness: less is rounding


def check_prior(prior: Solution, machine: Machine) -> None:
    """Raise `InputError` unless the axes that both machines have are the same axes."""
    common = [letter for letter in machine.letters if letter in prior.machine.letters]
    if not common:
        raise InputError(f"prior: its machine '{prior.machine.name}' has no axis of machine '{machine.name}'")
    for letter in common:
        old, new = prior.campaign.machine.axis(letter), machine.axis(letter)
        for what in ("primed", "travel", "reference", "error_point", "point", "unit_vector", "pitch"):
            if getattr(old, what) != getattr(new, what):
                raise InputError(
                    f"prior: {what} of axis {letter} is {getattr(old, what)} in its machine '{prior.machine.name}', but "
                    f"{getattr(new, what)} in machine '{machine.name}'; a prior must describe the same axes"
                )
    for name in sorted(shared_names(prior, machine) & set(motion_names(machine)) & set(motion_names(prior.machine))):
        old_settings, new_settings = settings_for(prior.machine, name), settings_for(machine, name)
        for what in ("degree", "over", "reversal"):
            if getattr(old_settings, what) != getattr(new_settings, what):
                raise InputError(
                    f"prior: {name} has {what} = {getattr(old_settings, what)} in its machine file and "
                    f"{getattr(new_settings, what)} in that of the campaign; [model.functions] must agree on {name}"
                )


def shared_names(prior: Solution, machine: Machine) -> set[str]:
    """Functions about which a prior has information: of axes that both machines have; the tool frame where the heads agree."""
    same = _head(prior.machine) == _head(machine)
    names = set()
    for name in prior.model.names:
        axis = parse(name).axis
        if axis in machine.letters or (axis == SPINDLE and same):
            names.add(name)
    return names


def _head(machine: Machine) -> tuple[str, ...]:
    """Letters of the rotary axes that carry the tool."""
    return tuple(a.letter for a in machine.axes if not a.is_linear and not a.primed)


def stated_segments(prior: Solution, machine: Machine) -> dict[str, tuple[int, ...]]:
    """Segments of functions that both have, where the earlier fit did not estimate their smoothness."""
    names = (shared_names(prior, machine) & set(motion_names(machine))) - prior.smooth_functions
    return {n: v for n, v in prior.model.segments.items() if n in names}


def prior_of(prior: Solution, model: ErrorModel) -> Prior:
    """Pseudo-readings on the parameters of `model` that `prior` knows."""
    names = shared_names(prior, model.machine)
    like, mapping = _in_ranges_of(prior, model)
    onto = np.zeros((like.n_parameters, model.n_parameters))
    for f in model.functions:
        old = like.by_name.get((f.name, f.part))
        if f.name in names and old is not None and old.splines == _as_in(prior, model, f.splines):
            onto[old.parameters, f.parameters] = np.eye(f.parameters.stop - f.parameters.start)
    if not _head(prior.machine) and _head(model.machine):
        for old in like.tool_frame:
            onto[old.parameters] = _orientation_at_zero(model, old.name)
    concerned = np.flatnonzero(np.any(mapping[:, np.any(onto != 0.0, axis=1)] != 0.0, axis=1))
    rows, value = _information_root(prior, concerned)
    return Prior(value, rows @ mapping[concerned] @ onto)


def _orientation_at_zero(model: ErrorModel, name: str) -> np.ndarray:
    """Rows (1, n) of the rotation that a head and its tool frame have together with the head at 0: what a machine without the
    head
    calls the orientation of its tool frame (its translations are those of the workpiece)."""
    row = np.zeros((1, model.n_parameters))
    zero = np.zeros((len(model.machine.axes), 1))
    if parse(name).is_rotation:
        for letter in (*_head(model.machine), SPINDLE):
            for symbol in (f"{name[:2]}{letter}", f"{name[:2]}0{letter}"):
                row += function_rows(model, symbol, zero, zero)
    return row


def _in_ranges_of(prior: Solution, model: ErrorModel) -> tuple[ErrorModel, np.ndarray]:
    """The prior's model over the ranges of `model`, and S with θ_prior = S θ of it, by the fields over the prior's ranges."""
    machine, ranges = prior.machine, {a.letter: a.travel for a in model.machine.axes}
    wider = machine.over({a: r for a, r in ranges.items() if a in machine.letters})
    if wider.axes == machine.axes:
        return prior.model, np.eye(prior.model.n_parameters)
    like = build_model(wider, prior.model.segments, carrier=prior.model.carrier, datum=prior.datum)
    return like, s_transformation(like, prior.model, exact=False)[0]


def _information_root(prior: Solution, there: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """W (r, n) and t (r,): what the prior's readings say of its parameters numbers `there`.

    Only combinations that they determine whatever the prior's other parameters are: those across its null space.
    """
    units = parameter_units(prior.model)[there]
    null = np.asarray(prior.null_space)[there] / units[:, None]
    vectors, values, _ = np.linalg.svd(null, full_matrices=True)
    across = vectors[:, int(np.sum(values > 1e-9)) :]
    smooth = prior.smooth_rows[:, there] * units @ across
    known = prior.bare_covariance[np.ix_(there, there)]
    variances, axes = np.linalg.eigh(across.T @ (known / np.outer(units, units)) @ across)
    seen = variances > EXACT * max(float(variances[-1]), 1e-300) if len(variances) else np.zeros(0, dtype=bool)
    deviations, axes = np.sqrt(variances[seen]), axes[:, seen]
    assumed = smooth @ (axes * deviations)
    shares, own = np.linalg.eigh(
        np.eye(len(deviations)) - assumed.T @ assumed
    )  # of the readings in each combination's information
    kept = shares > ROUNDING
    root, whiten = np.sqrt(shares[kept]), own[:, kept].T @ (axes / deviations).T @ across.T
    value = whiten @ (np.asarray(prior.parameters)[there] / units)
    return np.asarray(root[:, None] * whiten / units / prior.factor), np.asarray(value / root / prior.factor)


def prior_notes(prior: Solution, campaign: Campaign) -> tuple[str, ...]:
    """What a user should know about a prior: rejected by its own data, not converged, not fully determined, of another state."""
    notes = _other_state(prior.campaign, campaign)
    if prior.adequacy.rejected:
        notes.append(f"the prior was rejected by its own data, so its u is too small: {prior.adequacy.verdict}")
    if not prior.statistics.converged:
        notes.append("the prior's own fit had not converged")
    if not prior.fully_determined:
        notes.append("the prior does not determine everything; it counts only for what it determines")
    return tuple(notes)


def _other_state(earlier: Campaign, campaign: Campaign) -> list[str]:
    """That other compensations were active while the prior was measured, by both records of conditions (ISO/TR 16907 10.5)."""
    before, now = (active_compensations(c.conditions) for c in (earlier, campaign))
    if set(before) == set(now):
        return []
    return [
        f"the prior was measured with other compensations active ({'; '.join(before) or 'none'}) than the campaign "
        f"({'; '.join(now) or 'none'}): the machine had other errors, and the prior holds only for axes that these do not move"
    ]


def _as_in(prior: Solution, model: ErrorModel, splines):  # type: ignore[no-untyped-def]
    """Splines of the new model with the axis numbers of the prior's machine."""
    letters = model.machine.letters
    return tuple(s._replace(axis=prior.machine.index(letters[s.axis])) for s in splines)
