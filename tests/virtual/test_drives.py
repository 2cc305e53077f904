"""Errors that put every body of a machine where it is when its axes stand elsewhere, against the exact chain."""

import numpy as np
import pytest
from exact_chain import ExactMachine, random_truth
from support.drives import both_truths
from support.machines import LAYOUTS, NUTATING, THREE_ROTARY, exact_machine, volid_machine

from volid.model.kinematics import functional_point, transform
from volid.virtual.drives import directions_of_drives, with_steps

NANOMETRE = 1e-6  # mm
STRUCTURES = {**LAYOUTS, **NUTATING, "three rotary axes": THREE_ROTARY, "linear": "w Y' X' b Z t"}


def off_the_axes(structure: str) -> ExactMachine:
    """The machine with error points away from the origin and from the axis lines."""
    exact = exact_machine(structure)
    shifts = np.random.default_rng(9).uniform(-150.0, 150.0, (len(exact.axes), 3)).round(1)
    exact.error_point = {a: exact.error_point[a] + s for a, s in zip(exact.axes, shifts, strict=True)}
    return exact


@pytest.mark.parametrize("structure", STRUCTURES.values(), ids=STRUCTURES)
@pytest.mark.parametrize("moved", [False, True])
def test_every_body_stands_where_its_axes_put_it(structure, moved):
    exact = off_the_axes(structure) if moved else exact_machine(structure)
    machine, rng = volid_machine(exact), np.random.default_rng(4)
    truth = random_truth(exact, rng, reversal=True)
    q = np.stack([rng.uniform(*exact.travel[a], 40) for a in exact.axes], axis=1)
    # corrections of 0.1 mm and 0.02°, ten times what a good machine needs, or of nothing at all in some rows
    steps = rng.uniform(-1.0, 1.0, q.shape) * np.array([0.1 if a in "XYZ" else 0.02 for a in exact.axes])
    steps[:10] = 0.0
    way, point = rng.choice([-1.0, 1.0], q.shape), np.array([70.0, -40.0, -220.0])
    errors = with_steps(machine, both_truths(machine, truth).errors(q + steps, way), steps)
    columns = tuple(np.full(40, c) for c in point)
    for number, body in enumerate(["workpiece", *exact.axes]):
        start = number if body == "workpiece" else exact.axes.index(body) + (not exact.primed[body])
        found = np.stack(np.broadcast_arrays(*transform(machine, q.T, errors, columns, start=start)), axis=1)
        pose = exact.body_pose(body, q + steps, truth, way)
        np.testing.assert_allclose(found, pose[:, :3, :3] @ point + pose[:, :3, 3], rtol=0, atol=NANOMETRE)
    found = np.stack(functional_point(machine, q.T, columns, errors), axis=1)
    expected = exact.functional_point(q + steps, point, truth, way)
    np.testing.assert_allclose(found, expected, rtol=0, atol=NANOMETRE)
    bare = exact.functional_point(q, point, truth, way)
    assert np.abs(expected - bare)[10:].max() > 0.05


def test_turns_of_the_largest_size_stay_within_what_is_stated():
    """0.25° about an axis 1 m away: θ³/6 of it is 14 nm."""
    exact = ExactMachine("w C' b X Y Z t", {a: (-500.0, 500.0) for a in "XYZ"} | {"C": (-180.0, 180.0)})
    machine, q = volid_machine(exact), np.zeros((1, 4))
    steps = np.array([[0.25, 0.0, 0.0, 0.0]])
    errors = with_steps(machine, np.zeros((30, 1)), steps)
    found = np.stack(functional_point(machine, q.T, tuple(np.array([[1000.0], [0.0], [0.0]])), errors), axis=1)
    assert np.linalg.norm(found - exact.functional_point(q + steps, [1000.0, 0.0, 0.0])) < 1.5e-5


def test_a_correction_that_changes_by_rounding_alone_is_no_motion():
    q, way = np.full((3, 1), 10.0), np.ones((3, 1))
    driven = np.array([[10.001], [10.001 - 1e-13], [10.0005]])
    assert directions_of_drives(q, driven, way).ravel().tolist() == [1.0, 1.0, -1.0]


def test_an_axis_approached_from_an_unknown_side_stays_unknown_until_it_is_moved():
    q = np.array([[0.0], [5.0], [5.0], [5.0]])
    driven = q + np.array([[0.0], [0.0], [0.0], [0.002]])
    assert directions_of_drives(q, driven, np.zeros((4, 1))).ravel().tolist() == [0.0, 0.0, 0.0, 1.0]
