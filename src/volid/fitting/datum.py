"""Changing the datum: an S-transformation of solution and covariance, never a new fit (CONVENTIONS 4).

Two datums describe one deviation field up to a rigid motion of the workpiece frame: A θ = A' θ' + R ρ. Solving for θ' and
ρ at enough points gives the linear map θ' = S θ, and C' = S C Sᵀ. Baarda 1973; Teunissen 1985.
"""

from __future__ import annotations

from collections.abc import Collection

import numpy as np

from volid.exceptions import InputError
from volid.fitting.diagnosis.identifiability import UNIT, parameter_units, undetermined_directions
from volid.fitting.prediction.deviations import gradient_matrix
from volid.model.error_model import LOCATION, ErrorModel
from volid.model.jacobian import rigid_motion_rows, tool_rotation_rows
from volid.model.machine import Datum, Machine
from volid.model.rigid_fields import column_space, without

LAST_CHOICE = 1e-5  # weight of a motion of the tool vectors, which stands for what the model cannot express otherwise
ARM = 500.0  # mm: weighs rotations against translations in the comparison of two fields


def parse_datum(machine: Machine, text: str) -> Datum:
    """The datum that a text such as "primary=Z,secondary=X,line=end_point,reference_X=0" describes.

    Args:
        machine: The machine whose datum holds for everything that the text leaves out.
        text: pairs of key and value: primary, secondary, line, and reference_ with an axis letter [mm or degrees].

    Raises:
        InputError: an unknown key or one given twice, an axis that the machine does not have, or primary equal to secondary.

    >>> import volid
    >>> volid.parse_datum(volid.load_machine("models/wYXbZt_vertical.toml"), "primary=Z,secondary=X").primary
    'Z'
    """
    values = {"primary": machine.datum.primary, "secondary": machine.datum.secondary, "line": machine.datum.line}
    reference = dict(machine.datum.reference)
    seen: set[str] = set()
    for part in filter(None, (p.strip() for p in text.split(","))):
        key, _, value = (x.strip() for x in part.partition("="))
        if key in seen:
            raise InputError(f"datum: {key} is given twice; expected every key once")
        seen.add(key)
        if key.startswith("reference_"):
            reference[machine.axis(key.removeprefix("reference_")).letter] = _number(key, value)
        elif key in values:
            values[key] = value
        else:
            raise InputError(f"datum: unknown key '{key}'; expected primary, secondary, line or reference_X, _Y, _Z")
    _check_axes(machine, values["primary"], values["secondary"], seen)
    if values["line"] not in ("least_squares", "end_point"):
        raise InputError(f"datum: line = '{values['line']}'; expected least_squares or end_point")
    return Datum(values["primary"], values["secondary"], values["line"], tuple(sorted(reference.items())))


def _check_axes(machine: Machine, primary: str, secondary: str, stated: Collection[str]) -> None:
    """Raises `InputError` for a primary or secondary axis that is none; a machine with fewer linear axes has none to state."""
    linear = [axis.letter for axis in machine.linear]
    known = f"this machine has one linear axis, {linear[0]}" if linear else "this machine has no linear axis"
    for key, letter, needed in (("primary", primary, 1), ("secondary", secondary, 2)):
        if key in stated and len(linear) < needed:
            raise InputError(f"datum: {key} = '{letter}': {known}; leave {key} out")
        if letter not in linear and len(linear) >= needed:
            raise InputError(f"datum: {key} = '{letter}' is no linear axis of this machine; it has {', '.join(linear)}")
    if primary and primary == secondary:
        raise InputError(f"datum: primary and secondary axis are both {primary}; they must differ")


def _number(key: str, value: str) -> float:
    try:
        number = float(value)
    except ValueError:
        number = np.nan
    if not np.isfinite(number):
        raise InputError(f"datum: {key} = '{value}' is not a number; expected a position in mm or degrees")
    return number


def sample_points(machine: Machine, n: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Well-spread positions, tool vectors and approach directions for comparing fields."""
    from scipy.stats import qmc  # takes as long to import as most fits last

    axes = len(machine.axes)
    unit = qmc.Sobol(axes + 3, seed=1).random(int(2 ** np.ceil(np.log2(n))))
    low = np.array([a.travel[0] for a in machine.axes])
    length = np.array([a.length for a in machine.axes])
    positions = low + np.clip(unit[:, :axes] * 1.1 - 0.05, 0.0, 1.0) * length
    tool = (unit[:, axes:] - 0.5) * 2.0 * ARM
    direction = np.random.default_rng(1).choice([-1.0, 1.0], size=positions.shape)
    return positions, tool, direction


def _nominal_gradient(model: ErrorModel, positions: np.ndarray, tool: np.ndarray, direction: np.ndarray) -> np.ndarray:
    """∂(deviation)/∂θ at the nominal machine, (m, 6, n)."""
    return gradient_matrix(model, np.zeros(model.n_parameters), positions, tool, direction)


def s_transformation(
    old: ErrorModel, new: ErrorModel, hold: np.ndarray | None = None, exact: bool = True
) -> tuple[np.ndarray, np.ndarray]:
    """S with θ' = S θ, shape (n', n), and the rigid motion ρ = R θ of the workpiece frame, shape (6, n).

    `hold`: projector (n', n') that keeps at 0 those directions of the tool frame's constants that are held there. The rest of the
    model takes over their effect as far as it can; what remains is a motion of the tool vectors, which is left out of θ'.
    `exact`: the new model expresses every field of the old one; without it, the nearest over the new model's ranges is taken.

    Raises `InputError` when the new datum needs a squareness that the old model leaves out.
    """
    machine = new.machine
    n = max(old.n_parameters, new.n_parameters) + 16
    positions, tool, direction = sample_points(machine, n)
    weight = np.array([1.0, 1.0, 1.0, ARM, ARM, ARM])[None, :, None]

    def flat(rows: np.ndarray) -> np.ndarray:
        return np.asarray((rows * weight).reshape(-1, rows.shape[2]))

    kept, fixed = _free_and_fixed(new, np.eye(new.n_parameters) if hold is None else hold)
    before = flat(_nominal_gradient(old, positions, tool, direction))
    field = flat(_nominal_gradient(new, positions, tool, direction))
    last = field @ fixed if new.tool_frame else flat(tool_rotation_rows(machine, positions, tool))
    design = np.hstack([field @ kept, flat(rigid_motion_rows(machine, positions, tool)), last])
    scale = 1.0 / np.maximum(np.linalg.norm(design, axis=0), 1e-300)
    scale[design.shape[1] - last.shape[1] :] *= LAST_CHOICE
    first = _same_constants(old, new)
    first = first if hold is None else hold @ first
    mapping, *_ = np.linalg.lstsq(design * scale, before - field @ first, rcond=1e-12)
    mapping = scale[:, None] * mapping
    misfit = np.linalg.norm(design @ mapping + field @ first - before, axis=0)
    if exact and np.any(misfit > 1e-6 * np.maximum(np.linalg.norm(before, axis=0), 1.0)):
        raise InputError(
            "datum: the model cannot be expressed in this datum; it leaves out a squareness, straightness or location error that "
            "the new datum needs (see [model.functions])"
        )
    n = kept.shape[1]
    return kept @ mapping[:n] + first, mapping[n : n + 6]


def _free_and_fixed(model: ErrorModel, hold: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Bases (n, n - r) and (n, r) of what a projector keeps and removes; it is symmetric in physical units."""
    units = parameter_units(model)
    values, vectors = np.linalg.eigh(hold * units / units[:, None])
    return units[:, None] * vectors[:, values > 0.5], units[:, None] * vectors[:, values <= 0.5]


def split_null_space(model: ErrorModel, null_space: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The combinations that are not determined, in two kinds (n, d₁) and (n, d₂), in θ's units.

    Combinations of the first kind move only the workpiece frame, or nothing at all. They are a matter of datum, not of data: the
    place of a head is the place of the workpiece (EX0C, EY0C, EZ0A of a fork head), and table and head share a direction (EX0C
    and EX0B of C' … B). Holding them at 0 makes no compensation worse. The second kind is all others.
    """
    if not null_space.shape[1]:
        return null_space, null_space
    units = parameter_units(model)
    null = undetermined_directions(null_space, units)
    positions, tool, direction = sample_points(model.machine, 64)
    weight = np.array([1.0, 1.0, 1.0, ARM, ARM, ARM])[None, :, None]
    field = _nominal_gradient(model, positions, tool, direction) @ (units[:, None] * null)
    field = (field * weight).reshape(-1, null.shape[1])
    rigid = (rigid_motion_rows(model.machine, positions, tool) * weight).reshape(len(field), 6)
    deforming = without(column_space(rigid), field)
    _, values, vt = np.linalg.svd(deforming, full_matrices=True)
    harmless = np.append(values, np.zeros(len(vt) - len(values))) < 1e-6 * np.sqrt(len(field)) * UNIT
    return units[:, None] * (null @ vt[harmless].T), units[:, None] * (null @ vt[~harmless].T)


def _same_constants(old: ErrorModel, new: ErrorModel) -> np.ndarray:
    """Start of S, shape (n', n): constants that both models have keep their values unless the datum demands otherwise.

    This matters only where the data do not decide: the offset of a head from the linear axes, for example, is the same as the
    place of the workpiece.
    """
    start = np.zeros((new.n_parameters, old.n_parameters))
    for (name, part), f in new.by_name.items():
        if part == LOCATION and (name, part) in old.by_name:
            start[f.parameters, old.by_name[name, part].parameters] = 1.0
    return start
