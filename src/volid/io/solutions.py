"""Solutions in one self-contained HDF5 file, `volid-solution/1`, readable with plain h5py.

n: free parameters θ of the error model; c: spline coefficients and constants; k: nuisance parameters ν (stations, dead
paths, …); m: rows of a set, r: readings per row. Lengths [mm], rotations [rad], positions [mm or degrees].
Root attributes: `format`; `machine_name`; `axes` (letters, machine axis order); `options` (JSON text).
- `machine`: text of the machine file, scalar. `campaign/`: the whole campaign, laid out as a `volid-campaign/1` file.
- `datum/`: attributes `primary`, `secondary`, `line`; `reference` (JSON text: axis -> position that overrides its own).
- `functions/<ISO 230-1 symbol>/`, for those who only want to read: attributes `description`, `axis`, `unit`, `segments`;
  `position` (p,) (NaN for a constant), `direction` (p,), `value` and `u` (p,), NaN where the data do not determine it; a
  function of two axes stands at the other's reference. An error motion also has `coefficients`, one dimension per entry of its
  attributes `spline_axes`, `spline_low`, `spline_high`, `spline_segments`, `spline_degree`, `spline_periodic`:
  f(q) = Σ c_i B_i(q) with uniform knots low + (high - low)/segments · (i - degree); when periodic, q is taken into
  [low, high) and c_i goes on with c_(i - segments).
  `reversal_coefficients` likewise: B = E(+) - E(-); a single number when B is constant.
- `parameters/`: `label`, `function` (several, joined by +, when their datum rules couple them), `part`, `unit`, `value`, `u`,
  each (n,): coordinates of the coefficients in a basis that keeps to the datum. `model/`: attributes `segments` and `carrier`
  (JSON texts: symbol -> intervals that were chosen, and in which coefficients are stored), `parametrisation` P (c, n) and
  `coefficients` P θ (c,).
- `nuisance/`: `name`, `unit`, `value`, `u`, each (k,), and what the fit began with: `start`, `prior_u` (inf: unknown, 0:
  exact), `spread`; `distribution`, `effect`; `key` (JSON list: what it is) and `response` (JSON object: how it answers a rigid
  motion of the frame it lives in, see `volid.observations.response`).
- `covariance` (n + k, n + k): of (θ, ν), in the units of both; zero along what is not determined.
- `prior_root` (r, n), only after a fit with an earlier solution: its pseudo-readings W θ with unit variance.
- `identifiability/`: `statements` (text, what is not determined); `null_space` (n, d), undetermined combinations of θ;
  `held_directions` (s, h), directions of the s tool-frame constants held at 0; `undetermined/function`, `/directions`.
- `residuals/1`, `/2`, …, in the order of `campaign/sets`: attributes `set`, `rms`; `residual` (m, r) = reading - predicted,
  `normalised` (m, r) = residual/(u sqrt(1 - h)), `outlier` (m, r), set aside by the robust fit; on machines with rotary
  axes `held_out` (m, r) = reading - prediction by the fit to all other rotary positions, NaN where one alone carries something.
- `adequacy/`: attributes `verdict`, `rejected`, `chi_square`, `degrees_of_freedom`, `unit_weight`, `probability`; `groups/`:
  `what`, `n`, `unit_weight`, `probability`, each (g,), least probable first; `suspects/`: `where`, `label`, `residual`,
  `normalised`, `unit`, each (s,). `outliers/`: the same columns, for the readings that were set aside.
- `statistics/`: attributes `n_readings`, `n_parameters`, `iterations`, `converged`, `held_out_weight`
  (NaN: none). `notes`: text, (t,).
- `monte_carlo/`, once run: attributes `trials` M, `seed`, `tolerance` (numerical tolerance reached over the one wanted, NaN for a
  fixed M); `samples` (M, n + k) of (θ, ν); `chi_square`, `error` (distance to the minimum in standard uncertainties), `solved`
  (by the full solver), `outliers` (set aside in the trial), each (M,).
- `provenance/`: attributes: date, versions, command, SHA-256 of the inputs.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from dataclasses import fields, replace
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

import h5py
import numpy as np

from volid.campaign import Campaign
from volid.exceptions import InputError
from volid.fitting.diagnosis.adequacy import Adequacy, GroupTest, SuspectReading, reading_label
from volid.fitting.results import Residuals, Statistics, read_only
from volid.fitting.solution import Solution
from volid.io.basics.atomic import atomic_output
from volid.io.basics.hdf5_values import read_text, reading, to_json, write_array, write_text
from volid.io.campaign.hdf5 import read_campaign_group, write_campaign_group
from volid.io.nuisance import read_nuisance, write_nuisance
from volid.model.error_model import LOCATION, MEAN, ErrorModel, build_model
from volid.model.iso230 import describe, parse
from volid.model.machine import Datum
from volid.observations import KINDS
from volid.uncertainty.trials.samples import Samples

FORMAT = "volid-solution/1"
POINTS = 101  # of each function in `functions/`
_SAME_SPACE = 1e-9

Row = TypeVar("Row", GroupTest, SuspectReading)


def write_solution(solution: Solution, path: str | Path, overwrite: bool = False) -> None:
    """Write a solution, its campaign and machine included, to one HDF5 file; nothing is lost.

    Raises `OutputError` when `path` exists (unless `overwrite`) or cannot be written; then nothing is written.
    """
    with atomic_output(path, overwrite) as temporary, h5py.File(temporary, "w") as file:
        file.attrs["format"] = FORMAT
        file.attrs["machine_name"] = solution.machine.name
        file.attrs["axes"] = list(solution.machine.letters)
        file.attrs["options"] = to_json(solution.options)
        write_campaign_group(solution.campaign, file.create_group("campaign"))
        file["machine"] = file["campaign/machine"]
        _write_datum(file.create_group("datum"), solution.datum)
        _write_functions(file.create_group("functions"), solution)
        _write_parameters(file, solution)
        if solution.prior_root is not None:
            write_array(file, "prior_root", solution.prior_root)
        _write_identifiability(file.create_group("identifiability"), solution)
        _write_residuals(file.create_group("residuals"), solution)
        _write_rows(file.create_group("outliers"), SuspectReading, solution.readings.outlier_readings)
        _write_adequacy(file.create_group("adequacy"), solution.adequacy)
        for name in ("n_readings", "n_parameters", "iterations", "converged", "held_out_weight"):
            file.require_group("statistics").attrs[name] = getattr(solution.statistics, name)
        write_text(file, "notes", list(solution.notes))
        file.create_group("provenance").attrs.update(solution.provenance)
        if solution.samples is not None:
            _write_samples(file.create_group("monte_carlo"), solution.samples, np.asarray(solution.covariance).shape[0])


def _write_samples(group: h5py.Group, samples: Samples, width: int) -> None:
    """Batch by batch, so that memory stays bounded."""
    for name in ("trials", "seed", "tolerance"):
        group.attrs[name] = getattr(samples, name)
    for name in ("chi_square", "error", "solved", "outliers"):
        write_array(group, name, getattr(samples, name), getattr(samples, name).dtype)
    whole = group.create_dataset("samples", (samples.trials, width), "f8", chunks=(min(samples.trials, 1024), width))
    start = 0
    for batch in samples.batches():
        whole[start : start + len(batch)] = batch
        start += len(batch)


def _read_samples(file: h5py.File, path: str) -> Samples | None:
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


def _write_datum(group: h5py.Group, datum: Datum) -> None:
    for name in ("primary", "secondary", "line"):
        group.attrs[name] = getattr(datum, name)
    group.attrs["reference"] = to_json(dict(datum.reference))


def _write_functions(group: h5py.Group, solution: Solution) -> None:
    table = solution.functions(points=POINTS)
    for name in solution.model.names:
        error, rows = parse(name), [row for row in table if row.name == name]
        function = group.create_group(name)
        function.attrs["description"] = describe(name)
        function.attrs["axis"], function.attrs["unit"] = error.axis, error.unit
        axis = None if error.location else solution.machine.axis(error.axis)
        write_array(function, "position", [row.position for row in rows], unit="" if axis is None else axis.unit)
        write_array(function, "direction", [row.direction for row in rows], np.int8)
        write_array(function, "value", [row.value for row in rows], unit=error.unit)
        write_array(function, "u", [row.u for row in rows], unit=error.unit)
    coefficients = solution.model.parametrisation @ np.asarray(solution.parameters)
    for term, f in zip(solution.model.layout.terms, solution.model.functions, strict=True):
        if f.part != LOCATION:
            _write_spline(group[f.name], solution, f.part, term.basis.factors, coefficients[f.coefficients])
            group[f.name].attrs["segments"] = [s.segments for s in f.splines] or group[f.name].attrs["segments"]


def _write_spline(group: h5py.Group, solution: Solution, part: str, splines: Any, values: np.ndarray) -> None:
    name = "coefficients" if part == MEAN else f"{part}_coefficients"
    dataset = write_array(group, name, values.reshape([s.size for s in splines]), unit=group.attrs["unit"])
    dataset.attrs["spline_axes"] = [solution.machine.letters[s.axis] for s in splines] or h5py.Empty("S1")
    for key in ("low", "high", "segments", "degree", "periodic"):
        dataset.attrs[f"spline_{key}"] = [getattr(s, key) for s in splines]


def _write_parameters(file: h5py.File, solution: Solution) -> None:
    model, table = solution.model, solution.nuisance_table
    u = np.sqrt(np.maximum(np.diagonal(solution.covariance), 0.0))
    group = file.create_group("parameters")
    owners = [(names, part) for names, part, own in model.groups for _ in range(own.start, own.stop)]
    write_text(group, "label", model.parameter_labels())
    write_text(group, "function", ["+".join(names) for names, _ in owners])
    write_text(group, "part", [part for _, part in owners])
    write_text(group, "unit", [parse(names[0]).unit for names, _ in owners])
    write_array(group, "value", solution.parameters)
    write_array(group, "u", u[: model.n_parameters])
    group = file.create_group("model")
    group.attrs["segments"], group.attrs["carrier"] = to_json(model.segments), to_json(model.carrier)
    write_array(group, "parametrisation", model.parametrisation)
    write_array(group, "coefficients", model.parametrisation @ np.asarray(solution.parameters))
    group = file.create_group("nuisance")
    write_nuisance(group, table)
    write_array(group, "value", solution.nuisance)
    write_array(group, "u", u[model.n_parameters :])
    write_array(file, "covariance", solution.covariance)


def _write_identifiability(group: h5py.Group, solution: Solution) -> None:
    write_text(group, "statements", list(solution.statements))
    write_array(group, "null_space", solution.null_space)
    write_array(group, "held_directions", solution.held_directions)
    names = group.create_group("undetermined")
    write_text(names, "function", list(solution.undetermined))
    write_array(names, "directions", list(solution.undetermined.values()))


def _write_residuals(group: h5py.Group, solution: Solution) -> None:
    left = solution.readings
    for i, readings in enumerate(solution.campaign.sets):
        part = group.create_group(str(i + 1))
        part.attrs["set"], part.attrs["rms"] = readings.name, solution.statistics.residual_rms[readings.name]
        write_array(part, "residual", left.residuals[i], unit=KINDS[readings.kind].unit_words)
        write_array(part, "normalised", left.normalised[i])
        write_array(part, "outlier", left.outliers[i], bool)
        if left.held_out:
            write_array(part, "held_out", left.held_out[i], unit=KINDS[readings.kind].unit_words)


def _write_adequacy(group: h5py.Group, adequacy: Adequacy) -> None:
    for name in ("verdict", "rejected", "chi_square", "degrees_of_freedom", "unit_weight", "probability"):
        group.attrs[name] = getattr(adequacy, name)
    _write_rows(group.create_group("groups"), GroupTest, adequacy.groups)
    _write_rows(group.create_group("suspects"), SuspectReading, adequacy.suspects)


def _write_rows(group: h5py.Group, row: type[Row], rows: Sequence[Row]) -> None:
    """Records of one type as one dataset per field."""
    for field in fields(row):
        values = [getattr(r, field.name) for r in rows]
        if field.type == "str":
            write_text(group, field.name, values)
        else:
            write_array(group, field.name, values, int if field.type == "int" else float)


def _read_rows(group: h5py.Group, row: type[Row]) -> tuple[Row, ...]:
    columns = [(read_text(group[f.name]) if f.type == "str" else group[f.name][()]).tolist() for f in fields(row)]
    return tuple(row(*values) for values in zip(*columns, strict=True))


def read_solution(path: str | Path) -> Solution:
    """The solution stored in an HDF5 file: same parameters, deviations and covariance to the last bit.

    Raises `InputError` when the file is missing, truncated, not HDF5, of another type or version, incomplete, or when this
    version builds another error model from the machine and datum in it.
    """
    with reading(path, "solution", FORMAT) as file:
        campaign = read_campaign_group(file["campaign"], str(path))
        model = _read_model(file, campaign, str(path))
        numbers = _read_numbers(file, model, str(path))
        return Solution(
            **numbers._asdict(),
            model=model,
            campaign=campaign,
            nuisance_table=read_nuisance(file["nuisance"], campaign),
            adequacy=_read_adequacy(file["adequacy"], campaign),
            statistics=_read_statistics(file),
            readings=_read_residuals(file, campaign, str(path)),
            statements=tuple(read_text(file["identifiability/statements"]).tolist()),
            undetermined=_read_undetermined(file["identifiability/undetermined"]),
            notes=tuple(read_text(file["notes"]).tolist()),
            options=json.loads(file.attrs["options"]),
            samples=_read_samples(file, str(path)),
            prior_root=read_only(_read_array(file, "prior_root", (None, model.n_parameters), str(path)))
            if "prior_root" in file
            else None,
            provenance={key: str(value) for key, value in file["provenance"].attrs.items()},
        )


def _read_model(file: h5py.File, campaign: Campaign, path: str) -> ErrorModel:
    """The error model, with the file's own P: a basis of the datum's constraints is unique up to a rotation only."""
    attributes = file["datum"].attrs
    reference = tuple(json.loads(attributes["reference"]).items())
    datum = Datum(attributes["primary"], attributes["secondary"], attributes["line"], reference)
    segments, carrier = (
        {name: tuple(numbers) for name, numbers in json.loads(file["model"].attrs[key]).items()}
        for key in ("segments", "carrier")
    )
    model = build_model(campaign.machine, segments, carrier=carrier, datum=datum)
    stored = file["model/parametrisation"][()]
    if stored.shape != model.parametrisation.shape or not _same_space(model, stored):
        raise InputError(
            f"{path}: this volid builds another error model from the machine, segments and datum in the file than the one "
            "that was fitted; fit the campaign again"
        )
    return model if np.array_equal(stored, model.parametrisation) else replace(model, parametrisation=stored)


def _same_space(model: ErrorModel, stored: np.ndarray) -> bool:
    """Whether the columns of two parametrisations span the same coefficients, group by group of functions."""
    for names, part, own in model.groups:
        members = [model.by_name[name, part].coefficients for name in names]
        rows = np.concatenate([np.arange(c.start, c.stop) for c in members])
        ours, theirs = (p[rows, own] for p in (model.parametrisation, stored))
        both = np.linalg.lstsq(ours, theirs, rcond=None)[0]
        if not np.all(np.abs(ours @ both - theirs) <= _SAME_SPACE) or np.linalg.matrix_rank(theirs) < theirs.shape[1]:
            return False
    return True


class _Numbers(NamedTuple):
    parameters: np.ndarray
    nuisance: np.ndarray
    covariance: np.ndarray
    null_space: np.ndarray
    held_directions: np.ndarray


def _read_numbers(file: h5py.File, model: ErrorModel, path: str) -> _Numbers:
    n, k = model.n_parameters, len(file["nuisance/name"])
    places = {
        "parameters": ("parameters/value", (n,)),
        "nuisance": ("nuisance/value", (k,)),
        "covariance": ("covariance", (n + k, n + k)),
        "null_space": ("identifiability/null_space", (n, None)),
        "held_directions": ("identifiability/held_directions", (None, None)),
    }
    return _Numbers(
        **{name: read_only(_read_array(file, where, shape, path)) for name, (where, shape) in places.items()}
    )


def _read_array(file: h5py.File, where: str, shape: tuple[int | None, ...], path: str) -> np.ndarray:
    values = file[where][()]
    if values.ndim != len(shape) or any(e not in (None, f) for e, f in zip(shape, values.shape, strict=True)):
        expected = tuple("any" if e is None else e for e in shape)
        raise InputError(f"{path}, {where}: shape is {values.shape}; expected {expected}")
    return np.asarray(values)


def _read_suspects(group: h5py.Group, campaign: Campaign) -> tuple[SuspectReading, ...]:
    """Named readings; the unit that files of earlier versions do not hold is that of the reading in the campaign."""
    if "unit" in group:
        return _read_rows(group, SuspectReading)
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


def _read_adequacy(group: h5py.Group, campaign: Campaign) -> Adequacy:
    attributes = group.attrs
    return Adequacy(
        chi_square=float(attributes["chi_square"]),
        degrees_of_freedom=int(attributes["degrees_of_freedom"]),
        unit_weight=float(attributes["unit_weight"]),
        probability=float(attributes["probability"]),
        groups=_read_rows(group["groups"], GroupTest),
        suspects=_read_suspects(group["suspects"], campaign),
        rejected=bool(attributes["rejected"]),
        verdict=attributes["verdict"],
    )


def _read_statistics(file: h5py.File) -> Statistics:
    attributes, parts = file["statistics"].attrs, file["residuals"]
    return Statistics(
        n_readings=int(attributes["n_readings"]),
        n_parameters=int(attributes["n_parameters"]),
        residual_rms={parts[i].attrs["set"]: float(parts[i].attrs["rms"]) for i in sorted(parts, key=int)},
        iterations=int(attributes["iterations"]),
        converged=bool(attributes["converged"]),
        held_out_weight=float(attributes.get("held_out_weight", np.nan)),
    )


def _read_residuals(file: h5py.File, campaign: Campaign, path: str) -> Residuals:
    def column(name: str) -> tuple[np.ndarray, ...]:
        return tuple(
            _read_array(file, f"residuals/{i}/{name}", s.readings.shape, path)
            for i, s in enumerate(campaign.sets, start=1)
        )

    outliers = _read_suspects(file["outliers"], campaign)
    held_out = column("held_out") if "residuals/1/held_out" in file else ()
    return Residuals(column("residual"), column("normalised"), column("outlier"), outliers, held_out)


def _read_undetermined(group: h5py.Group) -> dict[str, float]:
    return dict(zip(read_text(group["function"]).tolist(), group["directions"][()].tolist(), strict=True))
