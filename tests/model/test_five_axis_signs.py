"""Signs in a closed loop, for every layout and one error at a time: exact chain, model, and compensated command agree.

For each of the six motions and the 4 + 1 location errors of every rotary axis (and the tool frame's constants): the exact chain
gives the deviation, the model must give the same, and the command corrected by minus the model's deviation through the linear
axes' nominal Jacobian must, on the exact chain, put the tool where it should be. CONVENTIONS 3 and 5.
"""

from dataclasses import replace

import numpy as np
import pytest
from exact_chain import Truth
from support.machines import NUTATING, ROTARY_TABLE, STRUCTURES, THREE_ROTARY, exact_machine, resolved
from support.made_up import made_up, truth_of

from volid.fitting.prediction.deviations import deviation_values

ALL = {**STRUCTURES, **NUTATING, "four axes": ROTARY_TABLE, "three rotary axes": THREE_ROTARY}
# 15 µm and 60 µrad at 900 mm: products of two errors, and errors at the corrected instead of the commanded position
SECOND_ORDER = 1e-5  # mm
SECOND_ORDER_ROTATION = 1e-8  # rad


def names_of(exact):
    """Six motions, four location errors and the zero of each rotary axis, and the constants of the tool frame."""
    names = []
    for axis in (a for a in exact.axes if a in "ABC"):
        own = "XYZ"["ABC".index(axis)]
        names += [f"E{d}{axis}" for d in "XYZABC"]
        names += [f"E{d}0{axis}" for d in "XYZABC" if d != own]
    head = any(a in "ABC" and not exact.primed[a] for a in exact.axes)
    return names + [f"E{d}0S" for d in ("XYZABC" if head else "ABC")]


def single(solution, truth, name):
    """Coefficients of the model and the truth with every error but one set to zero (datum couplings included)."""
    all_of_them = solution.model.parametrisation @ np.asarray(solution.parameters)
    coefficients = np.zeros_like(all_of_them)
    (function,) = [f for f in solution.model.functions if f.name == name]
    coefficients[function.coefficients] = all_of_them[function.coefficients]
    if name in truth.constants:
        return coefficients, Truth({}, {name: truth.constants[name]})
    return coefficients, Truth({name: truth.functions[name]}, {})


def correction(exact, q, tool, deviation):
    """Change of the linear axes' commands: minus the machine-frame deviation through their nominal Jacobian."""
    columns = [exact.column(a) for a in "XYZ"]
    start, step = exact.functional_point(q, tool), np.eye(len(exact.axes))
    jacobian = np.stack([exact.functional_point(q + step[c], tool) - start for c in columns], axis=-1)
    in_workpiece = np.einsum("mij,mj->mi", exact.table_rotation(q), deviation)
    change = np.zeros_like(q)
    change[:, columns] = -np.linalg.solve(jacobian, in_workpiece[..., None])[..., 0]
    return change


@pytest.mark.parametrize("layout", ALL)
def test_one_error_at_a_time(layout):
    exact = exact_machine(ALL[layout])
    zeros = "\n".join(f"E{a}0{a} = true" for a in exact.axes if a in "ABC")
    solution = made_up(resolved(exact, zeros, segments=6), seed=3)
    free = replace(solution.model, parametrisation=np.eye(solution.model.layout.n_coefficients))
    full = truth_of(solution)
    rng = np.random.default_rng(8)
    low, high = np.array([exact.travel[a] for a in exact.axes]).T
    q = low + rng.random((60, len(low))) * (high - low)
    tool = np.array([0.0, 0.0, -150.0]) + rng.uniform(-120.0, 120.0, (60, 3))
    target = exact.functional_point(q, tool)
    names = names_of(exact)
    assert set(names) <= set(solution.model.names)
    for name in names:
        coefficients, truth = single(solution, full, name)
        true = exact.deviation(q, tool, truth)
        size = np.linalg.norm(true[:, :3], axis=1).max()
        assert size > 0.001, f"{name}: an error that does nothing proves nothing"
        model = deviation_values(free, coefficients, q, tool, np.zeros_like(q))
        assert np.abs(model - true)[:, :3].max() < SECOND_ORDER, name
        assert np.abs(model - true)[:, 3:].max() < SECOND_ORDER_ROTATION, name
        change = correction(exact, q, tool, model[:, :3])
        left = exact.functional_point(q + change, tool, truth) - target
        assert np.linalg.norm(left, axis=1).max() < SECOND_ORDER < 0.01 * size, name
        doubled = exact.functional_point(q - change, tool, truth) - target
        assert np.linalg.norm(doubled, axis=1).max() > 1.99 * size, name


def test_three_rotary_axes_without_errors_deviate_nowhere_and_with_all_errors_as_the_exact_chain():
    exact = exact_machine(THREE_ROTARY)
    solution = made_up(resolved(exact, segments=4), seed=5)
    rng = np.random.default_rng(3)
    low, high = np.array([exact.travel[a] for a in exact.axes]).T
    q = low + rng.random((40, 6)) * (high - low)
    tool = rng.uniform(-100.0, 100.0, (40, 3))
    still = np.zeros_like(q)
    nothing = deviation_values(solution.model, np.zeros(solution.model.n_parameters), q, tool, still)
    assert np.abs(nothing).max() < 1e-11
    found = deviation_values(solution.model, np.asarray(solution.parameters), q, tool, still)
    true = exact.deviation(q, tool, truth_of(solution))
    assert np.abs(found - true)[:, :3].max() < 1e-7 < 0.02 < np.abs(true[:, :3]).max()  # rotations to their third power
    assert np.abs(found - true)[:, 3:].max() < 1e-9


def test_tilt_of_the_table_lifts_the_side_the_convention_says():
    """Closed form. EA0C = +20 µrad of C': tool turned about X relative to the workpiece, so 100 mm in +Y goes +2 µm in Z."""
    exact = exact_machine(ROTARY_TABLE)
    truth = Truth({}, {"EA0C": 20e-6})
    x, y, z = exact.point["C"]
    q = exact.in_axis_order({"C": [0.0, 90.0, 180.0], "X": x, "Y": y + 100.0, "Z": z})
    np.testing.assert_allclose(
        exact.deviation(q, np.zeros(3), truth), np.tile([0, 0, 0.002, 20e-6, 0, 0], (3, 1)), atol=1e-7
    )
    solution = made_up(resolved(exact, '"E??" = false\n"E?0?" = false\nEA0C = true', segments=4))
    value = float(solution.parameters[0])
    np.testing.assert_allclose(
        np.asarray(solution.deviation(q, np.zeros(3))), np.tile([0, 0, 100 * value, value, 0, 0], (3, 1)), atol=1e-7
    )
