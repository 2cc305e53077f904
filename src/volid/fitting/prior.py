"""An earlier solution as prior knowledge: linear axes measured before the rotary ones (ISO/TR 16907 10.3).

Functions that both models hold get the earlier values as pseudo-readings W (θ - θ0) with WᵀW = C⁻¹, the inverse of the
earlier covariance on what the earlier data determined. The prior contains no information about what they did not determine. To
first order this equals a joint fit of both campaigns (recursive least squares; Koch, Parameter Estimation, 3.3).
"""

from __future__ import annotations

import numpy as np

from volid.exceptions import InputError
from volid.fitting.diagnosis.identifiability import parameter_units
from volid.fitting.equations.problem import Prior
from volid.fitting.solution import Solution
from volid.model.error_functions import motion_names, settings_for
from volid.model.error_model import ErrorModel
from volid.model.iso230 import SPINDLE, parse
from volid.model.machine import Machine

EXACT = 1e-12  # eigenvalues of the scaled covariance below this share of the largest carry no information


def check_prior(prior: Solution, machine: Machine) -> None:
    """Raise `InputError` unless the axes that both machines have are the same axes."""
    common = [letter for letter in machine.letters if letter in prior.machine.letters]
    if not common:
        raise InputError(f"prior: its machine '{prior.machine.name}' has no axis of machine '{machine.name}'")
    for letter in common:
        old, new = prior.machine.axis(letter), machine.axis(letter)
        for what in ("primed", "travel", "reference", "error_point", "point", "unit_vector"):
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
    """Functions about which a prior has information: of axes that both machines have; the tool frame only without a head."""
    head = any(not a.is_linear and not a.primed for m in (machine, prior.machine) for a in m.axes)
    names = set()
    for name in prior.model.names:
        axis = parse(name).axis
        if axis in machine.letters or (axis == SPINDLE and not head):
            names.add(name)
    return names


def prior_of(prior: Solution, model: ErrorModel) -> Prior:
    """Pseudo-readings on the parameters of `model` that `prior` knows."""
    names = shared_names(prior, model.machine)
    here, there = [], []
    for f in model.functions:
        old = prior.model.by_name.get((f.name, f.part))
        if f.name in names and old is not None and old.splines == _as_in(prior, model, f.splines):
            new_numbers = range(f.parameters.start, f.parameters.stop)
            pairs = zip(new_numbers, range(old.parameters.start, old.parameters.stop), strict=True)
            for a, b in pairs:
                if a not in here:
                    here.append(a)
                    there.append(b)
    mean = np.zeros(model.n_parameters)
    mean[here] = np.asarray(prior.parameters)[there]
    units = parameter_units(model)[here]
    rows = _information_root(prior, np.array(there, dtype=int), units)
    root = np.zeros((len(rows), model.n_parameters))
    root[:, here] = rows / units
    return Prior(mean, root)


def _information_root(prior: Solution, there: np.ndarray, units: np.ndarray) -> np.ndarray:
    """W with WᵀW = information on the parameters `there` in physical units, (r, n).

    Only combinations that the prior's data determine whatever its other parameters are: those across its null space.
    """
    null = np.asarray(prior.null_space)[there] / units[:, None]
    vectors, values, _ = np.linalg.svd(null, full_matrices=True)
    across = vectors[:, int(np.sum(values > 1e-9)) :]
    covariance = across.T @ (prior.parameter_covariance[np.ix_(there, there)] / np.outer(units, units)) @ across
    variances, axes = np.linalg.eigh(covariance)
    known = variances > EXACT * max(float(variances[-1]), 1e-300) if len(variances) else np.zeros(0, dtype=bool)
    return np.asarray((across @ axes[:, known] / np.sqrt(variances[known])).T)


def prior_notes(prior: Solution) -> tuple[str, ...]:
    """What a user should know about a prior: rejected by its own data, not converged, not fully determined."""
    notes = []
    if prior.adequacy.rejected:
        notes.append(f"the prior was rejected by its own data, so its u is too small: {prior.adequacy.verdict}")
    if not prior.statistics.converged:
        notes.append("the prior's own fit had not converged")
    if not prior.fully_determined:
        notes.append("the prior does not determine everything; it counts only for what it determines")
    return tuple(notes)


def _as_in(prior: Solution, model: ErrorModel, splines):  # type: ignore[no-untyped-def]
    """Splines of the new model with the axis numbers of the prior's machine."""
    letters = model.machine.letters
    return tuple(s._replace(axis=prior.machine.index(letters[s.axis])) for s in splines)
