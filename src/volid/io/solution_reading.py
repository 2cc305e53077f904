"""The parts of a solution from groups of an HDF5 file; `volid.io.solutions` describes them."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import MISSING, fields, replace
from math import prod
from typing import NamedTuple

import numpy as np

from volid.campaign import Campaign
from volid.exceptions import InputError
from volid.fitting.diagnosis.adequacy import GRADES, Adequacy, Cause, GroupTest, Question, SuspectReading, reading_label
from volid.fitting.mixed.records import SetTest, VarianceComponent
from volid.fitting.results import Residuals, SmoothPrior, Statistics, read_only
from volid.io.basics.hdf5_group import Group
from volid.io.basics.hdf5_structure import shown
from volid.io.basics.hdf5_values import reading
from volid.io.basics.toml_table import Table
from volid.io.machines import LINES
from volid.io.solution_writing import Row
from volid.model.error_model import ErrorModel, build_model
from volid.model.machine import Datum, Machine
from volid.observations import KINDS
from volid.uncertainty.trials.samples import Samples

FORMAT = "volid-solution/1"
_SAME_SPACE = 1e-9
AT_ONCE = 1024  # trials


def read_samples(file: Group, width: int) -> Samples | None:
    """Samples that stay in the file until they are asked for, batch by batch (b, `width`)."""
    if "monte_carlo" not in file:
        return None
    group, path = file.group("monte_carlo"), file.source
    trials, attributes = group.length("samples", 2), group.attributes
    if attributes.integer("trials") != trials:
        raise InputError(
            f"{group.place('samples')}: {trials} rows; expected attribute trials, {attributes.integer('trials')}"
        )
    group.dataset("samples", (trials, width))

    def batches() -> Iterator[np.ndarray]:
        with reading(path, "solution", FORMAT) as again:
            for start in range(0, trials, AT_ONCE):
                part = slice(start, start + AT_ONCE)
                yield again.group("monte_carlo").array("samples", (trials, width), rows=part)

    return Samples(
        trials=trials,
        batches=batches,
        chi_square=group.array("chi_square", (trials,)),
        error=group.array("error", (trials,)),
        solved=group.array("solved", (trials,), bool),
        outliers=group.array("outliers", (trials,), int),
        seed=attributes.integer("seed"),
        tolerance=attributes.number("tolerance", finite=False),
    )


def read_rows(group: Group, row: type[Row]) -> tuple[Row, ...]:
    """Records of one type from one dataset per field; a field with a default may be absent from files of earlier versions."""
    stored = [f for f in fields(row) if f.name in group or f.default is MISSING]
    n = group.length(stored[0].name)
    columns = [_column(group, f.name, str(f.type), n).tolist() for f in stored]
    named = (dict(zip([f.name for f in stored], values, strict=True)) for values in zip(*columns, strict=True))
    return tuple(row(**values) for values in named)


def _column(group: Group, name: str, stored: str, n: int) -> np.ndarray:
    kinds: dict[str, type] = {"int": int, "bool": bool}
    return group.texts(name, (n,)) if stored == "str" else group.array(name, (n,), kinds.get(stored, float))


def read_model(file: Group, campaign: Campaign) -> ErrorModel:
    """The error model, with the file's own P: a basis of the datum's constraints is unique up to a rotation only."""
    group = file.group("model")
    stored = group.array("parametrisation", (None, None), finite=True)
    segments, carrier = (_intervals(group, key, len(stored)) for key in ("segments", "carrier"))
    machine = campaign.machine.over(_ranges(group, campaign.machine))
    model = build_model(machine, segments, carrier=carrier, datum=_datum(file.group("datum"), campaign.machine))
    if stored.shape != model.parametrisation.shape or not _same_space(model, stored):
        raise InputError(
            f"{file.source}: this volid builds another error model from the machine, segments and datum in the file than the one "
            "that was fitted; fit the campaign again"
        )
    return model if np.array_equal(stored, model.parametrisation) else replace(model, parametrisation=stored)


def _intervals(group: Group, key: str, most: int) -> dict[str, tuple[int, ...]]:
    """Intervals of every error motion; a spline has more coefficients than intervals, all together are `most`."""
    found = group.attributes.json(key, dict)
    for name, numbers in found.items():
        whole = isinstance(numbers, list) and all(type(n) is int and 1 <= n <= most for n in numbers)
        if not whole or prod(numbers) > most:
            raise InputError(
                f"{group.where}, attribute {key}: '{shown(name)}' has {shown(str(numbers))}; expected whole numbers >= 1, for "
                f"{most} coefficients in all"
            )
    return {name: tuple(numbers) for name, numbers in found.items()}


def _ranges(group: Group, machine: Machine) -> dict[str, tuple[float, float]]:
    """Measured range of every axis."""
    table = Table(group.attributes.json("ranges", dict, "{}"), f"{group.where}, attribute ranges")
    table.only(machine.letters)
    found = {letter: table.vector(letter, 2) for letter in table.data}
    for letter, (low, high) in found.items():
        if not low < high:
            raise table.wrong(letter, "two increasing positions")
    return found


def _datum(group: Group, machine: Machine) -> Datum:
    """The datum that parameters and covariance refer to."""
    attributes = group.attributes
    table = Table(attributes.json("reference", dict), f"{group.where}, attribute reference")
    table.only(machine.letters)
    reference = tuple((letter, table.number(letter)) for letter in table.data)
    letters = {name: attributes.text(name) for name in ("primary", "secondary")}
    for name, letter in letters.items():
        if letter and letter not in machine.letters:
            raise InputError(f"{group.where}, attribute {name} is '{shown(letter)}'; expected an axis of the machine")
    line = attributes.text("line")
    if line not in LINES:
        raise InputError(f"{group.where}, attribute line is '{shown(line)}'; expected {' or '.join(LINES)}")
    return Datum(**letters, line=line, reference=reference)


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


def read_numbers(file: Group, model: ErrorModel) -> Numbers:
    """The arrays of a solution. Raises `InputError` for another shape than the model has, or an impossible value."""
    n, nuisance, identifiability = model.n_parameters, file.group("nuisance"), file.group("identifiability")
    k = nuisance.length("name")
    numbers = Numbers(
        parameters=file.group("parameters").array("value", (n,), finite=True),
        nuisance=nuisance.array("value", (k,), finite=True),
        covariance=file.array("covariance", (n + k, n + k), finite=True),
        null_space=identifiability.array("null_space", (n, None), finite=True),
        held_directions=identifiability.array("held_directions", (None, None), finite=True),
    )
    if (np.diagonal(numbers.covariance) < 0.0).any():
        raise InputError(f"{file.place('covariance')}: a variance is negative; expected variances >= 0")
    return Numbers(*map(read_only, numbers))


def read_prior(file: Group, model: ErrorModel) -> np.ndarray | None:
    """Pseudo-readings of an earlier solution, (r, n); None without."""
    if "prior_root" not in file:
        return None
    return read_only(file.array("prior_root", (None, model.n_parameters), finite=True))


def read_smoothness(file: Group, numbers: Numbers) -> SmoothPrior | None:
    """What was assumed of the smoothness of the functions. Raises `InputError` for a wrong shape."""
    if "smoothness" not in file:
        return None
    group = file.group("smoothness")
    n, p = len(numbers.parameters), len(numbers.covariance)
    r, h = group.dataset("noise", (None, None)).shape
    count = group.length("name")
    shapes = {"value": (count,), "u": (count,), "root": (r, n), "noise": (r, h), "spread": (p, h)}
    value, u, root, noise, spread = (read_only(group.array(name, s, finite=True)) for name, s in shapes.items())
    table = Table(group.attributes.json("scatter", dict, "{}"), f"{group.where}, attribute scatter")
    scatter = {name: table.number(name, least=0.0) for name in table.data}
    return SmoothPrior(tuple(group.texts("name", (count,)).tolist()), value, u, root, noise, spread, scatter)


def read_variance_components(file: Group) -> tuple[VarianceComponent, ...]:
    """By which factors u was changed; () where it was not. Raises `InputError` for a factor that is none."""
    if "variance_components" not in file:
        return ()
    group = file.group("variance_components")
    found = read_rows(group, VarianceComponent)
    for component in found:
        if not component.factor > 0.0:
            raise InputError(f"{group.place('factor')}: a factor is {component.factor:g}; expected a number > 0")
    return found


def read_suspects(group: Group, campaign: Campaign) -> tuple[SuspectReading, ...]:
    """Named readings; the unit that files of earlier versions do not hold is that of the reading in the campaign."""
    rows = read_rows(group, SuspectReading)
    return rows if "unit" in group else tuple(replace(row, unit=_unit_of(row, campaign)) for row in rows)


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


def read_adequacy(group: Group, campaign: Campaign) -> Adequacy:
    """The verdict with its tests by group."""
    attributes = group.attributes
    grade = attributes.text("grade", "")
    if grade and grade not in GRADES:
        raise InputError(f"{group.where}, attribute grade is '{shown(grade)}'; expected one of {', '.join(GRADES)}")
    return Adequacy(
        chi_square=attributes.number("chi_square", finite=False),
        degrees_of_freedom=attributes.integer("degrees_of_freedom"),
        unit_weight=attributes.number("unit_weight", finite=False),
        probability=attributes.number("probability", finite=False),
        groups=read_rows(group.group("groups"), GroupTest),
        suspects=read_suspects(group.group("suspects"), campaign),
        rejected=attributes.flag("rejected"),
        verdict=attributes.text("verdict"),
        grade=grade,
        factor=attributes.number("factor", 1.0),
        causes=_read_causes(group.group("causes")) if "causes" in group else (),
        questions=_read_questions(group.group("questions")) if "questions" in group else (),
        sets=read_rows(group.group("sets"), SetTest) if "sets" in group else (),
        redundancy=_or_nan(attributes.number("redundancy", math.nan, finite=False)),
        reading_weight=_or_nan(attributes.number("reading_weight", math.nan, finite=False)),
    )


def _or_nan(value: float) -> float:
    """The value; one NaN for all, so that equal verdicts compare equal."""
    return math.nan if math.isnan(value) else value


def _read_questions(group: Group) -> tuple[Question, ...]:
    n = group.length("text")
    about = group.array("about_values", (n,), bool).tolist()
    return tuple(Question(*pair) for pair in zip(group.texts("text", (n,)).tolist(), about, strict=True))


def _read_causes(group: Group) -> tuple[Cause, ...]:
    """What explains a misfit; only the change of the result may be infinite."""
    n = group.length("cause")
    for name in ("drop", "gain", "log10_probability"):
        group.array(name, (n,), finite=True)
    if np.isnan(group.array("change", (n,))).any():
        raise InputError(f"{group.place('change')}: a value is NaN; expected numbers, or infinity")
    return read_rows(group, Cause)


def read_statistics(file: Group, campaign: Campaign) -> Statistics:
    """Numbers about the fit."""
    attributes, parts = file.group("statistics").attributes, file.group("residuals").numbered()
    rms = {part.attributes.text("set"): part.attributes.number("rms", finite=False) for part in parts}
    if list(rms) != [s.name for s in campaign.sets]:
        raise InputError(
            f"{file.place('residuals')}: of sets {shown(', '.join(rms))}; expected those of the campaign in order"
        )
    return Statistics(
        n_readings=attributes.integer("n_readings"),
        n_parameters=attributes.integer("n_parameters"),
        residual_rms=rms,
        iterations=attributes.integer("iterations"),
        converged=attributes.flag("converged"),
    )


def read_residuals(file: Group, campaign: Campaign) -> Residuals:
    """Residuals of every reading of the campaign. Raises `InputError` for a wrong shape."""
    parts = file.group("residuals").numbered()

    def column(name: str, kind: type = float) -> tuple[np.ndarray, ...]:
        return tuple(g.array(name, s.readings.shape, kind) for g, s in zip(parts, campaign.sets, strict=True))

    outliers = read_suspects(file.group("outliers"), campaign)
    held_out = column("held_out") if parts and "held_out" in parts[0] else ()
    return Residuals(column("residual"), column("normalised"), column("outlier", bool), outliers, held_out)


def read_undetermined(group: Group) -> dict[str, float]:
    """By function, in how many directions it is not determined."""
    n = group.length("function")
    values = group.array("directions", (n,), finite=True)
    return dict(zip(group.texts("function", (n,)).tolist(), values.tolist(), strict=True))
