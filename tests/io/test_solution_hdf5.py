"""Solutions as HDF5: nothing is lost, plain h5py can read them, and damaged files are named."""

import json
from dataclasses import fields, replace

import h5py
import jax
import numpy as np
import pytest
from scipy.interpolate import NdBSpline
from support.hdf5_files import changed
from support.small_campaign import SINGLE_TOOL, SOLUTIONS

from volid.exceptions import InputError, OutputError
from volid.io import write_campaign
from volid.io.solutions import read_solution, write_solution
from volid.model.machine import Datum
from volid.uncertainty.trials.samples import Samples

ARRAYS = ("parameters", "nuisance", "covariance", "null_space", "held_directions")
TOOL = np.array([30.0, -20.0, -180.0])


@pytest.fixture(params=SOLUTIONS)
def pair(request, tmp_path):
    """A solution and what comes back from its file."""
    solution = request.getfixturevalue(request.param)
    path = tmp_path / "solution.h5"
    write_solution(solution, path)
    return solution, read_solution(path)


def some_positions(machine, n=40):
    rng = np.random.default_rng(3)
    return np.stack([rng.uniform(*axis.travel, n) for axis in machine.axes], axis=1)


def test_deviations_and_uncertainties_are_the_same_to_the_last_bit(pair):
    before, after = pair
    q = some_positions(before.machine)
    direction = np.sign(np.random.default_rng(4).standard_normal(q.shape))
    for a, b in zip(before.evaluate(q, TOOL, direction), after.evaluate(q, TOOL, direction), strict=True):
        np.testing.assert_array_equal(a, b)


def test_all_numbers_are_the_same_to_the_last_bit(pair):
    before, after = pair
    for name in ARRAYS:
        np.testing.assert_array_equal(np.asarray(getattr(before, name)), np.asarray(getattr(after, name)))
    for name in ("residuals", "normalised", "outliers"):
        for a, b in zip(getattr(before.readings, name), getattr(after.readings, name), strict=True):
            np.testing.assert_array_equal(a, b)
            assert a.dtype == b.dtype


def test_everything_said_about_the_fit_is_kept(pair):
    before, after = pair
    for name in ("adequacy", "statements", "undetermined", "notes", "options", "provenance", "variance_components"):
        assert getattr(before, name) == getattr(after, name), name
    assert repr(before.statistics) == repr(after.statistics)  # as text, so that NaN equals NaN
    assert before.nuisance_table == after.nuisance_table
    assert before.readings.outlier_readings == after.readings.outlier_readings
    assert before.datum == after.datum
    assert before.model.segments == after.model.segments
    assert before.model.carrier == after.model.carrier
    assert before.model.parameter_labels() == after.model.parameter_labels()


def test_the_campaign_is_inside(pair):
    before, after = (solution.campaign for solution in pair)
    assert before.machine == after.machine
    assert before.machine.text == after.machine.text
    assert (before.title, before.stations, before.conditions) == (after.title, after.stations, after.conditions)
    for a, b in zip(before.sets, after.sets, strict=True):
        for field in fields(a):
            x, y = getattr(a, field.name), getattr(b, field.name)
            if isinstance(x, np.ndarray):
                np.testing.assert_array_equal(x, y)
            elif field.name == "labels":
                assert {k: v.tolist() for k, v in x.items()} == {k: v.tolist() for k, v in y.items()}
            else:
                assert x == y


def test_prior_and_samples_are_kept(solution, tmp_path):
    """Pseudo-readings of an earlier solution, and Monte Carlo samples over more than one chunk, read batch by batch."""
    rng = np.random.default_rng(8)
    n, p = solution.model.n_parameters, solution.covariance.shape[0]
    x, columns = rng.standard_normal((1500, p)), rng.random((4, 1500))
    samples = Samples(
        trials=1500, batches=lambda: iter([x[:700], x[700:]]), chi_square=columns[0], error=columns[1],
        solved=columns[2] > 0.5, outliers=(3 * columns[3]).astype(int), seed=11, tolerance=0.5,
    )  # fmt: skip
    root = rng.standard_normal((3, n))
    write_solution(replace(solution, samples=samples, prior_root=root), tmp_path / "s.h5")
    after = read_solution(tmp_path / "s.h5")
    np.testing.assert_array_equal(np.asarray(after.prior_root), root)
    np.testing.assert_array_equal(after.samples.outputs(lambda v: v), x)
    for name in ("chi_square", "error", "solved", "outliers"):
        np.testing.assert_array_equal(getattr(after.samples, name), getattr(samples, name))
    assert (after.samples.trials, after.samples.seed, after.samples.tolerance) == (1500, 11, 0.5)


def test_no_field_of_a_solution_is_forgotten(solution, solution_file):
    after = read_solution(solution_file)
    compared = {"model", "campaign", "nuisance_table", "adequacy", "statistics", "readings", "statements"}
    compared |= {
        "undetermined",
        "notes",
        "options",
        "provenance",
        "prior_root",
        "smooth",
        "samples",
        "variance_components",
        *ARRAYS,
    }
    assert {field.name for field in fields(after)} == compared, "a new field: write it, read it, compare it above"


def test_a_solution_that_was_read_is_differentiable(solution, solution_file):
    """Its leaves take part in JAX transformations like those of a fresh one."""

    def height(solution):
        return solution.deviation([100.0, 200.0, -300.0], TOOL)[2]

    before, after = jax.grad(height)(solution), jax.grad(height)(read_solution(solution_file))
    assert np.abs(after.parameters).max() > 0.1
    np.testing.assert_array_equal(np.asarray(before.parameters), np.asarray(after.parameters))


@pytest.mark.parametrize("name", ["solution", "rich_solution"])
def test_the_datum_can_be_changed_after_reading(name, request, tmp_path):
    before = request.getfixturevalue(name)
    write_solution(before, tmp_path / "s.h5")
    datum = Datum("Z", "X", "end_point", (("X", 100.0), ("Y", 50.0)))
    a, b = before.in_datum(datum), read_solution(tmp_path / "s.h5").in_datum(datum)
    np.testing.assert_array_equal(np.asarray(a.parameters), np.asarray(b.parameters))
    np.testing.assert_array_equal(np.asarray(a.covariance), np.asarray(b.covariance))
    write_solution(b, tmp_path / "moved.h5")
    again = read_solution(tmp_path / "moved.h5")
    assert again.datum == datum
    q = some_positions(before.machine)
    np.testing.assert_array_equal(a.evaluate(q, TOOL).values, again.evaluate(q, TOOL).values)


def rotate_basis(path):
    """Another orthonormal basis of the datum's constraints, as another linear-algebra library would choose it."""
    with changed(path) as file:
        p, theta = file["model/parametrisation"][()], file["parameters/value"][()]
        n, size = len(theta), len(file["covariance"])
        turn = np.eye(size)
        names, parts = (file[f"parameters/{key}"][()] for key in ("function", "part"))
        rng = np.random.default_rng(8)
        for key in dict.fromkeys(zip(names, parts, strict=True)):
            own = np.flatnonzero([k == key for k in zip(names, parts, strict=True)])
            turn[np.ix_(own, own)] = np.linalg.qr(rng.standard_normal((len(own), len(own))))[0]
        file["model/parametrisation"][...] = p @ turn[:n, :n]
        file["parameters/value"][...] = turn[:n, :n].T @ theta
        file["covariance"][...] = turn.T @ file["covariance"][()] @ turn


@pytest.mark.parametrize("name", ["solution", "rotary_solution"])
def test_a_file_from_a_computer_with_another_basis_gives_the_same_deviations(name, request, tmp_path):
    solution, path = request.getfixturevalue(name), tmp_path / "foreign.h5"
    write_solution(solution, path)
    rotate_basis(path)
    foreign = read_solution(path)
    q = some_positions(solution.machine)
    before, after = solution.evaluate(q, TOOL), foreign.evaluate(q, TOOL)
    assert not np.allclose(np.asarray(solution.parameters), foreign.parameters, atol=1e-6)
    np.testing.assert_allclose(after.values, before.values, rtol=0, atol=1e-12)  # mm, rad: rounding
    np.testing.assert_allclose(after.u, before.u, rtol=1e-6)
    if name == "rotary_solution":
        return
    moved = foreign.in_datum(Datum("Z", "X")).evaluate(q, TOOL)
    np.testing.assert_allclose(moved.values, solution.in_datum(Datum("Z", "X")).evaluate(q, TOOL).values, atol=1e-9)


def test_a_file_of_an_earlier_version_without_sorts_of_groups_is_read(solution, solution_file, tmp_path):
    path = tmp_path / "older.h5"
    path.write_bytes(solution_file.read_bytes())
    with changed(path) as file:
        del file["adequacy/groups/sort"]
    groups = read_solution(path).adequacy.groups
    assert groups == tuple(replace(g, sort="") for g in solution.adequacy.groups)
    assert read_solution(solution_file).adequacy.groups == solution.adequacy.groups


def test_another_error_model_is_refused(solution_file, tmp_path):
    path = tmp_path / "other.h5"
    path.write_bytes(solution_file.read_bytes())
    with changed(path) as file:
        file["model/parametrisation"][0, 0] += 1e-3
    with pytest.raises(InputError, match=r"other\.h5: this volid builds another error model .* fit the campaign again"):
        read_solution(path)


# ------------------------------------------------------------------------------------------------------ plain h5py


def test_functions_can_be_read_with_plain_h5py(solution, solution_file):
    table = {}
    for row in solution.functions(points=101):
        table.setdefault(row.name, []).append(row)
    with h5py.File(solution_file) as file:
        assert set(file["functions"]) == set(solution.model.names)
        for name, group in file["functions"].items():
            rows = table[name]
            np.testing.assert_array_equal(group["value"], [r.value for r in rows])
            np.testing.assert_array_equal(group["u"], [r.u for r in rows])
            np.testing.assert_array_equal(group["position"], [r.position for r in rows])
        assert file["functions/EYX"].attrs["description"] == "straightness of X in Y direction"
        assert file["functions/EYX/value"].attrs["unit"] == "mm"
        assert file["functions/EBZ"].attrs["unit"] == "rad"
        assert file["functions/EBZ"].attrs["segments"].tolist() == [2]
        assert np.isnan(file["functions/EC0Y/position"][0])


def spline_values(dataset, positions):
    """The tensor-product spline that a dataset of coefficients describes, by the docstring's formula alone; (m,)."""
    if not dataset.shape:
        return dataset[()]
    keys = ("low", "high", "segments", "degree", "periodic")
    splines = list(zip(*(dataset.attrs[f"spline_{key}"] for key in keys), strict=True))
    knots = [low + (high - low) / n * (np.arange(n + 2 * d + 1) - d) for low, high, n, d, _ in splines]
    values = dataset[()]
    low, high, _, degree, periodic = splines[0]
    if periodic:
        values, positions = np.append(values, values[:degree]), low + np.mod(positions - low, high - low)
    return NdBSpline(tuple(knots), values, [int(s[3]) for s in splines])(positions)


@pytest.mark.parametrize("which", ["rich_solution", "rotary_solution"])
def test_splines_can_be_rebuilt_with_scipy(which, request, tmp_path):
    solution = request.getfixturevalue(which)
    write_solution(solution, tmp_path / "s.h5")
    with h5py.File(tmp_path / "s.h5") as file:
        motions = {name: group for name, group in file["functions"].items() if "coefficients" in group}
        for name, group in motions.items():
            q, axes = group["position"][()], group["coefficients"].attrs["spline_axes"]
            assert axes[0] == name[2]
            others = [np.full(len(q), solution.machine.axis(a).reference) for a in axes[1:]]
            value = spline_values(group["coefficients"], np.stack([q, *others], axis=1))
            if "reversal_coefficients" in group:
                reversal = spline_values(group["reversal_coefficients"], q[:, None])
                value = value + 0.5 * group["direction"][()] * reversal
            np.testing.assert_allclose(value, group["value"], rtol=0, atol=1e-12)
        if which == "rich_solution":
            assert file["functions/EZZ/coefficients"].attrs["spline_axes"].tolist() == ["Z", "X"]
            assert file["functions/EXX/reversal_coefficients"].shape == ()
            assert file["functions/EYY/reversal_coefficients"].shape == (5,)


def test_units_labels_and_texts_for_plain_h5py(single_tool_solution, tmp_path):
    write_solution(single_tool_solution, tmp_path / "s.h5")
    with h5py.File(tmp_path / "s.h5") as file:
        assert file.attrs["format"] == "volid-solution/1"
        assert file.attrs["axes"].tolist() == ["Y", "X", "Z"]
        assert file["machine"].asstr()[()] == single_tool_solution.machine.text
        assert file.attrs["machine_name"] == "Testmaschine Ω"
        labels = file["parameters/label"].asstr()[()].tolist()
        units = dict(zip(labels, file["parameters/unit"].asstr()[()].tolist(), strict=True))
        assert units["EXX[0]"] == "mm"
        assert units["EC0Y"] == "rad"
        u = np.sqrt(np.diagonal(file["covariance"][()]))
        np.testing.assert_allclose(np.append(file["parameters/u"], file["nuisance/u"]), u)
        assert "station S1 X" in file["nuisance/name"].asstr()[()].tolist()
        assert any("ECZ" in text for text in file["identifiability/statements"].asstr()[()].tolist())
        assert np.isnan(file["functions/ECZ/value"][0])
        assert json.loads(file.attrs["options"])["robust"] is False
        assert file["residuals/1"].attrs["set"] == "volume"
        assert file["residuals/1/residual"].attrs["unit"] == "mm"
        assert file["campaign/sets/1/tool"][0].tolist() == list(SINGLE_TOOL)


# --------------------------------------------------------------------------------------------------- wrong places


def test_an_existing_file_is_kept_unless_overwrite(solution, tmp_path):
    path = tmp_path / "solution.h5"
    path.write_text("mine")
    with pytest.raises(OutputError, match=r"solution\.h5 exists; choose another name or pass `overwrite=True`"):
        write_solution(solution, path)
    assert path.read_text() == "mine"
    write_solution(solution, path, overwrite=True)
    assert read_solution(path).adequacy == solution.adequacy


def test_nothing_is_left_when_writing_fails(solution, tmp_path):
    with pytest.raises(AttributeError):
        write_solution(replace(solution, options={"not for JSON": object()}), tmp_path / "s.h5")
    with pytest.raises(OutputError, match=r"the folder .* does not exist"):
        write_solution(solution, tmp_path / "nowhere" / "s.h5")
    assert list(tmp_path.iterdir()) == []


# ----------------------------------------------------------------------------------------------------- wrong files


@pytest.mark.parametrize("part", [0.0, 0.001, 0.3, 0.9, 0.999])
def test_a_truncated_file_is_refused(solution_file, tmp_path, part):
    data = solution_file.read_bytes()
    path = tmp_path / "short.h5"
    path.write_bytes(data[: int(part * len(data))])
    with pytest.raises(InputError, match=r"short\.h5: (not an HDF5 file|the HDF5 file is truncated)"):
        read_solution(path)


def damaged(solution_file, path, change):
    path.write_bytes(solution_file.read_bytes())
    with changed(path) as file:
        change(file)
    return path


def delete(name):
    def change(file):
        del file[name]

    return change


def shorten(name):
    def change(file):
        values = file[name][()]
        del file[name]
        file[name] = values[:-1]

    return change


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            lambda f: f.attrs.modify("format", "volid-solution/2"),
            "'volid-solution/2'; this volid reads 'volid-solution/1'",
        ),
        (lambda f: f.attrs.pop("format"), "attribute 'format' is missing; expected 'volid-solution/1'"),
        (delete("covariance"), "incomplete solution: .*covariance"),
        (delete("campaign/sets/1/readings"), "incomplete solution: .*readings"),
        (shorten("parameters/value"), r"parameters/value: shape is \(71,\); expected \(72,\)"),
        (shorten("covariance"), r"covariance: shape is \(\d+, \d+\); expected"),
        (shorten("residuals/1/residual"), r"residuals/1/residual: shape is \(359, 1\); expected \(360, 1\)"),
        (lambda f: f["model"].attrs.modify("segments", "{"), "model, attribute segments: no valid JSON"),
    ],
)
def test_a_damaged_file_is_named(solution_file, tmp_path, change, message):
    path = damaged(solution_file, tmp_path / "bad.h5", change)
    with pytest.raises(InputError, match=rf"bad\.h5.*{message}"):
        read_solution(path)


def test_other_files_are_no_solutions(solution, tmp_path):
    write_campaign(solution.campaign, tmp_path / "campaign.h5")
    with pytest.raises(InputError, match=r"this is a campaign \('volid-campaign/1'\); expected a solution"):
        read_solution(tmp_path / "campaign.h5")
    (tmp_path / "text.h5").write_text("function,axis\n")
    with pytest.raises(InputError, match=r"not an HDF5 file; expected a solution written by volid"):
        read_solution(tmp_path / "text.h5")
    with pytest.raises(InputError, match=r"no such file"):
        read_solution(tmp_path / "none.h5")
