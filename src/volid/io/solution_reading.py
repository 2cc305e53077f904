"""The parts of a solution from groups of an HDF5 file; `volid.io.solutions` describes them."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import MISSING, fields, replace
from typing import NamedTuple

import h5py
import numpy as np

from volid.campaign import Campaign
from volid.exceptions import InputError
from volid.fitting.diagnosis.adequacy import Adequacy, Cause, GroupTest, Question, SuspectReading, reading_label
from volid.fitting.results import Residuals, SmoothPrior, Statistics, read_only
from volid.io.basics.hdf5_values import read_text, reading
from volid.io.solution_writing import Row
from volid.model.error_model import ErrorModel, build_model
from volid.model.machine import Datum
from volid.observations import KINDS
from volid.uncertainty.trials.samples import Samples

FORMAT = "volid-solution/1"
_SAME_SPACE = 1e-9


def read_samples(file: h5py.File, path: str) -> Samples | None:
    """Samples that stay in the file until they are asked for."""
    if "monte_carlo" not in file:
        return None
    group = file["monte_carlo"]
    columns = {name: group[name][()] for name in ("chi_square", "error", "solved", "outliers")}
    trials = int(group.attrs["trials"])

    def batches() -> Iterator[np.ndarray]:
        with reading(path, "solution", FORMAT) as again:
            for start in range(0, trials, 1024):
                yield again["monte_carlo/samples"][start : start + 1024]

    return Samples(
        trials=trials,
        batches=batches,
        seed=int(group.attrs["seed"]),
        tolerance=float(group.attrs["tolerance"]),
        **columns,
    )


def read_rows(group: h5py.Group, row: type[Row]) -> tuple[Row, ...]:
    """Records of one type from one dataset per field; a field with a default may be absent from files of earlier versions."""
    stored = [f for f in fields(row) if f.name in group or f.default is MISSING]
    columns = [(read_text(group[f.name]) if f.type == "str" else group[f.name][()]).tolist() for f in stored]
    named = (dict(zip([f.name for f in stored], values, strict=True)) for values in zip(*columns, strict=True))
    return tuple(row(**values) for values in named)


def read_model(file: h5py.File, campaign: Campaign, path: str) -> ErrorModel:
    """The error model, with the file's own P: a basis of the datum's constraints is unique up to a rotation only."""
    attributes = file["datum"].attrs
    reference = tuple(json.loads(attributes["reference"]).items())
    datum = Datum(attributes["primary"], attributes["secondary"], attributes["line"], reference)
    segments, carrier = (
        {name: tuple(numbers) for name, numbers in json.loads(file["model"].attrs[key]).items()}
        for key in ("segments", "carrier")
    )
    ranges = json.loads(file["model"].attrs.get("ranges", "{}"))
    machine = campaign.machine.over({letter: (float(low), float(high)) for letter, (low, high) in ranges.items()})
    model = build_model(machine, segments, carrier=carrier, datum=datum)
    stored = file["model/parametrisation"][()]
    if stored.shape != model.parametrisation.shape or not _same_space(model, stored):
        raise InputError(
            f"{path}: this volid builds another error model from the machine, segments and datum in the file than the one "
            "that was fitted; fit the campaign again"
        )
    return model if np.array_equal(stored, model.parametrisation) else replace(model, parametrisation=stored)


def _same_space(model: ErrorModel, stored: np.ndarray) -> bool:
    """Whether the columns of two parametrisations span the same coefficients, group by group of functions."""
    for names, part, parameters in model.groups:
        members = [model.by_name[name, part].coefficients for name in names]
        rows = np.concatenate([np.arange(c.start, c.stop) for c in members])
        ours, theirs = (p[rows, parameters] for p in (model.parametrisation, stored))
        both = np.linalg.lstsq(ours, theirs, rcond=None)[0]
        if not np.all(np.abs(ours @ both - theirs) <= _SAME_SPACE) or np.linalg.matrix_rank(theirs) < theirs.shape[1]:
            return False
    return True


class Numbers(NamedTuple):
    parameters: np.ndarray
    nuisance: np.ndarray
    covariance: np.ndarray
    null_space: np.ndarray
    held_directions: np.ndarray


def read_numbers(file: h5py.File, model: ErrorModel, path: str) -> Numbers:
    """The arrays of a solution. Raises `InputError` for one of another shape than the model has."""
    n, k = model.n_parameters, len(file["nuisance/name"])
    places = {
        "parameters": ("parameters/value", (n,)),
        "nuisance": ("nuisance/value", (k,)),
        "covariance": ("covariance", (n + k, n + k)),
        "null_space": ("identifiability/null_space", (n, None)),
        "held_directions": ("identifiability/held_directions", (None, None)),
    }
    return Numbers(**{name: read_only(read_array(file, where, shape, path)) for name, (where, shape) in places.items()})


def read_array(file: h5py.File, where: str, shape: tuple[int | None, ...], path: str) -> np.ndarray:
    """A dataset. Raises `InputError` when its shape is not `shape`; None stands for any length."""
    values = file[where][()]
    if values.ndim != len(shape) or any(e not in (None, f) for e, f in zip(shape, values.shape, strict=True)):
        expected = tuple("any" if e is None else e for e in shape)
        raise InputError(f"{path}, {where}: shape is {values.shape}; expected {expected}")
    return np.asarray(values)


def read_smoothness(file: h5py.File, numbers: Numbers, path: str) -> SmoothPrior | None:
    """What was assumed of the smoothness of the functions. Raises `InputError` for a wrong shape."""
    if "smoothness" not in file:
        return None
    n, p = len(numbers.parameters), len(numbers.covariance)
    r, h = file["smoothness/noise"].shape
    count = len(file["smoothness/name"])
    shapes = {"value": (count,), "u": (count,), "root": (r, n), "noise": (r, h), "spread": (p, h)}
    arrays = [read_only(read_array(file, f"smoothness/{name}", shape, path)) for name, shape in shapes.items()]
    scatter = {name: float(u) for name, u in json.loads(file["smoothness"].attrs.get("scatter", "{}")).items()}
    value, u, root, noise, spread = arrays
    return SmoothPrior(tuple(read_text(file["smoothness/name"]).tolist()), value, u, root, noise, spread, scatter)


def read_suspects(group: h5py.Group, campaign: Campaign) -> tuple[SuspectReading, ...]:
    """Named readings; the unit that files of earlier versions do not hold is that of the reading in the campaign."""
    if "unit" in group:
        return read_rows(group, SuspectReading)
    names = [f.name for f in fields(SuspectReading) if f.name != "unit"]
    columns = [(read_text(group[n]) if n in ("where", "label") else group[n][()]).tolist() for n in names]
    rows = [SuspectReading(*values) for values in zip(*columns, strict=True)]
    return tuple(replace(row, unit=_unit_of(row, campaign)) for row in rows)


def _unit_of(row: SuspectReading, campaign: Campaign) -> str:
    for readings in campaign.sets:
        kind = KINDS[readings.kind]
        for i in range(len(readings)):
            if readings.where(i) != row.where:
                continue
            for k in range(len(kind.readings)):
                if reading_label(readings, i, k) == row.label:
                    return kind.unit_at(readings, i, k)
    return "mm"


def read_adequacy(group: h5py.Group, campaign: Campaign) -> Adequacy:
    """The verdict with its tests by group."""
    attributes = group.attrs
    return Adequacy(
        chi_square=float(attributes["chi_square"]),
        degrees_of_freedom=int(attributes["degrees_of_freedom"]),
        unit_weight=float(attributes["unit_weight"]),
        probability=float(attributes["probability"]),
        groups=read_rows(group["groups"], GroupTest),
        suspects=read_suspects(group["suspects"], campaign),
        rejected=bool(attributes["rejected"]),
        verdict=attributes["verdict"],
        grade=attributes.get("grade", ""),
        factor=float(attributes.get("factor", 1.0)),
        causes=read_rows(group["causes"], Cause) if "causes" in group else (),
        questions=_read_questions(group["questions"]) if "questions" in group else (),
    )


def _read_questions(group: h5py.Group) -> tuple[Question, ...]:
    about = group["about_values"][()].astype(bool).tolist()
    return tuple(Question(*pair) for pair in zip(read_text(group["text"]).tolist(), about, strict=True))


def read_statistics(file: h5py.File) -> Statistics:
    """Numbers about the fit."""
    attributes, parts = file["statistics"].attrs, file["residuals"]
    return Statistics(
        n_readings=int(attributes["n_readings"]),
        n_parameters=int(attributes["n_parameters"]),
        residual_rms={parts[i].attrs["set"]: float(parts[i].attrs["rms"]) for i in sorted(parts, key=int)},
        iterations=int(attributes["iterations"]),
        converged=bool(attributes["converged"]),
    )


def read_residuals(file: h5py.File, campaign: Campaign, path: str) -> Residuals:
    """Residuals of every reading of the campaign. Raises `InputError` for a wrong shape."""

    def column(name: str) -> tuple[np.ndarray, ...]:
        return tuple(
            read_array(file, f"residuals/{i}/{name}", s.readings.shape, path)
            for i, s in enumerate(campaign.sets, start=1)
        )

    outliers = read_suspects(file["outliers"], campaign)
    held_out = column("held_out") if "residuals/1/held_out" in file else ()
    return Residuals(column("residual"), column("normalised"), column("outlier"), outliers, held_out)


def read_undetermined(group: h5py.Group) -> dict[str, float]:
    """By function, in how many directions it is not determined."""
    return dict(zip(read_text(group["function"]).tolist(), group["directions"][()].tolist(), strict=True))
