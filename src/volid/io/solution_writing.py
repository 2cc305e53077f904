"""The parts of a solution as groups of an HDF5 file; `volid.io.solutions` describes them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields
from typing import Any, TypeVar

import h5py
import numpy as np

from volid.fitting.diagnosis.adequacy import Adequacy, Cause, GroupTest, SuspectReading
from volid.fitting.mixed.records import SetTest, VarianceComponent
from volid.fitting.results import SmoothPrior
from volid.fitting.solution import Solution
from volid.io.basics.hdf5_values import to_json, write_array, write_text
from volid.io.nuisance import write_nuisance
from volid.model.axis_lines import AXIS_LINE, is_of_a_line
from volid.model.error_model import LOCATION, MEAN
from volid.model.iso230 import describe, parse
from volid.model.machine import Datum
from volid.observations import KINDS
from volid.uncertainty.trials.samples import Samples

POINTS = 101  # of each function in `functions/`

_STORED: dict[str, type] = {"int": int, "bool": bool, "float": float}

Row = TypeVar("Row", Cause, GroupTest, SetTest, SuspectReading, VarianceComponent)


def write_samples(group: h5py.Group, samples: Samples, width: int) -> None:
    """Batch by batch, so that memory stays bounded."""
    for name in ("trials", "seed", "tolerance"):
        group.attrs[name] = getattr(samples, name)
    for name in ("chi_square", "error", "solved", "outliers"):
        write_array(group, name, getattr(samples, name), getattr(samples, name).dtype)
    written = group.create_dataset("samples", (samples.trials, width), "f8", chunks=(min(samples.trials, 1024), width))
    start = 0
    for batch in samples.batches():
        written[start : start + len(batch)] = batch
        start += len(batch)


def write_smoothness(group: h5py.Group, smooth: SmoothPrior) -> None:
    """What was assumed of the smoothness of the functions."""
    write_text(group, "name", list(smooth.names))
    for name, values in (("value", smooth.values), ("u", smooth.u), ("root", smooth.root)):
        write_array(group, name, values)
    for name, values in (("noise", smooth.noise), ("spread", smooth.spread)):
        write_array(group, name, values)
    group.attrs["scatter"] = to_json(smooth.scatter)


def write_variance_components(group: h5py.Group, solution: Solution) -> None:
    """By which factors u was changed, and the u that were stated, set by set."""
    write_rows(group, VarianceComponent, solution.variance_components)
    stated = group.create_group("stated_u")
    for i, (readings, u) in enumerate(zip(solution.campaign.sets, solution.stated_u, strict=True)):
        write_array(stated, str(i + 1), u, unit=KINDS[readings.kind].unit_words)


def write_datum(group: h5py.Group, datum: Datum) -> None:
    """The datum that parameters and covariance refer to."""
    for name in ("primary", "secondary", "line"):
        group.attrs[name] = getattr(datum, name)
    group.attrs["reference"] = to_json(dict(datum.reference))


def write_functions(group: h5py.Group, solution: Solution) -> None:
    """Every function as a table over its travel, and as spline coefficients."""
    table = solution.functions(points=POINTS)
    for name in solution.model.names:
        error, rows = parse(name), [row for row in table if row.name == name]
        function = group.create_group(name)
        function.attrs["description"] = describe(name)
        function.attrs["axis"], function.attrs["unit"] = error.axis, error.unit
        if is_of_a_line(name):
            function.attrs["refers_to"] = AXIS_LINE
        axis = None if error.location else solution.machine.axis(error.axis)
        write_array(function, "position", [row.position for row in rows], unit="" if axis is None else axis.unit)
        write_array(function, "direction", [row.direction for row in rows], np.int8)
        write_array(function, "value", [row.value for row in rows], unit=error.unit)
        write_array(function, "u", [row.u for row in rows], unit=error.unit)
    coefficients = solution.model.parametrisation @ np.asarray(solution.parameters)
    for term, f in zip(solution.model.layout.terms, solution.model.functions, strict=True):
        if f.part != LOCATION:
            _write_spline(group[f.name], solution, f.part, term.basis.factors, coefficients[f.coefficients])
            if f.part == MEAN:
                group[f.name].attrs["segments"] = [s.segments for s in f.splines]


def _write_spline(group: h5py.Group, solution: Solution, part: str, splines: Any, values: np.ndarray) -> None:
    name = "coefficients" if part == MEAN else f"{part}_coefficients"
    dataset = write_array(group, name, values.reshape([s.size for s in splines]), unit=group.attrs["unit"])
    dataset.attrs["spline_axes"] = [solution.machine.letters[s.axis] for s in splines] or h5py.Empty("S1")
    for key in ("low", "high", "segments", "degree", "periodic"):
        dataset.attrs[f"spline_{key}"] = [getattr(s, key) for s in splines]


def write_parameters(file: h5py.File, solution: Solution) -> None:
    """Parameters and other unknowns with their labels, the model that they belong to, and their covariance."""
    model, table = solution.model, solution.nuisance_table
    u = np.sqrt(np.maximum(np.diagonal(solution.covariance), 0.0))
    group = file.create_group("parameters")
    owners = [
        (names, part) for names, part, parameters in model.groups for _ in range(parameters.start, parameters.stop)
    ]
    write_text(group, "label", model.parameter_labels())
    write_text(group, "function", ["+".join(names) for names, _ in owners])
    write_text(group, "part", [part for _, part in owners])
    write_text(group, "unit", [parse(names[0]).unit for names, _ in owners])
    write_array(group, "value", solution.parameters)
    write_array(group, "u", u[: model.n_parameters])
    group = file.create_group("model")
    group.attrs["segments"], group.attrs["carrier"] = to_json(model.segments), to_json(model.carrier)
    group.attrs["ranges"] = to_json({a.letter: a.travel for a in model.machine.axes})
    write_array(group, "parametrisation", model.parametrisation)
    write_array(group, "coefficients", model.parametrisation @ np.asarray(solution.parameters))
    group = file.create_group("nuisance")
    write_nuisance(group, table)
    write_array(group, "value", solution.nuisance)
    write_array(group, "u", u[model.n_parameters :])
    write_array(file, "covariance", solution.covariance)


def write_identifiability(group: h5py.Group, solution: Solution) -> None:
    """What is not determined."""
    write_text(group, "statements", list(solution.statements))
    write_array(group, "null_space", solution.null_space)
    write_array(group, "held_directions", solution.held_directions)
    names = group.create_group("undetermined")
    write_text(names, "function", list(solution.undetermined))
    write_array(names, "directions", list(solution.undetermined.values()))


def write_residuals(group: h5py.Group, solution: Solution) -> None:
    """Residuals of every reading, set by set."""
    results = solution.readings
    for i, readings in enumerate(solution.campaign.sets):
        part = group.create_group(str(i + 1))
        part.attrs["set"], part.attrs["rms"] = readings.name, solution.statistics.residual_rms[readings.name]
        write_array(part, "residual", results.residuals[i], unit=KINDS[readings.kind].unit_words)
        write_array(part, "normalised", results.normalised[i])
        write_array(part, "outlier", results.outliers[i], bool)
        if results.held_out:
            write_array(part, "held_out", results.held_out[i], unit=KINDS[readings.kind].unit_words)


def write_adequacy(group: h5py.Group, adequacy: Adequacy) -> None:
    """The verdict with its tests by group."""
    for name in (
        "verdict",
        "grade",
        "rejected",
        "factor",
        "chi_square",
        "degrees_of_freedom",
        "unit_weight",
        "probability",
        "redundancy",
        "reading_weight",
    ):
        group.attrs[name] = getattr(adequacy, name)
    write_rows(group.create_group("causes"), Cause, adequacy.causes)
    asked = group.create_group("questions")
    write_text(asked, "text", [q.text for q in adequacy.questions])
    write_array(asked, "about_values", [q.about_values for q in adequacy.questions], bool)
    write_rows(group.create_group("groups"), GroupTest, adequacy.groups)
    if adequacy.sets:
        write_rows(group.create_group("sets"), SetTest, adequacy.sets)
    write_rows(group.create_group("suspects"), SuspectReading, adequacy.suspects)


def write_rows(group: h5py.Group, row: type[Row], rows: Sequence[Row]) -> None:
    """Records of one type as one dataset per field."""
    for field in fields(row):
        values = [getattr(r, field.name) for r in rows]
        if field.type == "str":
            write_text(group, field.name, values)
        else:
            write_array(group, field.name, values, _STORED[str(field.type)])
