"""Checks of a campaign before any fit: what cannot be right, what looks odd, and how well readings repeat."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from volid.backend.rms import rms
from volid.campaign import Campaign, ObservationSet
from volid.exceptions import InputError
from volid.model.machine import Machine
from volid.observations import KINDS
from volid.observations.base import takes_large_errors
from volid.plausibility.conditions import thermal_limit
from volid.plausibility.repeats import centres_as_readings, combine, first_of, repeats
from volid.plausibility.rotary import check_motion, check_radians, scattered
from volid.plausibility.same_sets import check_same_sets
from volid.plausibility.tools import check_stations, check_tools
from volid.plausibility.travels import check_digits, check_far, check_metres, check_outside
from volid.plausibility.units import check_lengths, positions_look_small

_ROWS_NAMED = 5
_ZEROS = 3  # positions at which a beam may read 0
_HOTTEST = 150.0  # °C
_CONTINUOUS = 1e-4  # of the spread of repeated readings: a resolution that is as good as continuous
_STEPS_TRIED = 1000  # differences that the resolution is found from
_COINCIDENCES = 10.0  # identical readings, over those expected by chance, that can be no chance


@dataclass(frozen=True)
class Closure:
    """How well the readings of one set repeat: later minus earliest reading at the same place, from the same direction.

    `reading`: the column. `n`: number of differences. `rms`, `max` (with its sign): root mean square and largest
    difference; `u`: root mean square of their standard uncertainties, all in the column's unit. `rms_ratio` and
    `max_ratio`: in units of each difference's own u. `rows`: line numbers of the largest difference, earlier one first.
    """

    set: str
    reading: str
    n: int
    rms: float
    max: float
    u: float
    rms_ratio: float
    max_ratio: float
    rows: tuple[int, int]


def check_campaign(campaign: Campaign) -> tuple[str, ...]:
    """Warnings about what looks odd in a campaign, each naming file and rows.

    Args:
        campaign: A campaign with readings.

    Raises:
        InputError: for what no fit can use: no readings, numbers that are not finite, u <= 0, duplicated rows or sets, readings
            or positions in another unit than mm, rad, degrees, spheres out of the sensor's range, or probing without any rotary
            motion. The text names file and row.

    >>> import volid
    >>> volid.check_campaign(volid.load_campaign("datasets/published_positioning/campaign.toml"))
    ()
    """
    if not any(len(readings) for readings in campaign.sets):
        raise InputError(f"{campaign.source or 'campaign'}: there are no readings; expected at least one set with rows")
    thermal_limit(campaign.conditions)
    warnings: list[str] = []
    for readings in campaign.sets:
        _check_numbers(readings)
        _check_labels(readings)
        _check_zeros(readings, campaign)
        check_digits(readings)
        _check_temperature(readings)
        check_far(readings, campaign.machine)
        KINDS[readings.kind].check_values(readings, campaign)
        if not takes_large_errors(readings):
            check_lengths(readings, campaign)
            check_radians(readings, campaign)
            check_metres(readings, campaign.machine)
            check_stations(readings, campaign)
        warnings += check_tools(readings, campaign)
        warnings += _small_positions(readings, campaign.machine)
        warnings += scattered(readings, campaign.machine)
        warnings += _outside_travel(readings, campaign.machine)
        warnings += _duplicates(readings, campaign.machine)
    check_same_sets(campaign)
    check_motion(campaign)
    check_outside(campaign)
    return tuple(warnings)


def _check_numbers(readings: ObservationSet) -> None:
    if np.isnan(readings.readings).all():
        raise InputError(f"{readings.source or readings.name}: the readings are missing; expected them, not a plan")
    numbers = readings.side_by_side._asdict() | {"readings": readings.readings, "u": readings.u}
    for name, values in numbers.items():
        wrong = ~np.isfinite(values).all(axis=1)
        if wrong.any():
            raise InputError(f"{readings.where(int(np.argmax(wrong)))}: {name} hold no finite number; expected one")
    wrong = (readings.u <= 0.0).any(axis=1)
    if wrong.any():
        i = int(np.argmax(wrong))
        raise InputError(f"{readings.where(i)}: u is {readings.u[i].min():g}; expected a standard uncertainty > 0")


def _check_temperature(readings: ObservationSet) -> None:
    """Raises `InputError` for temperatures in kelvin: no machine is measured at 150 °C."""
    if readings.temperature is None or not np.isfinite(readings.temperature).any():
        return
    i = int(np.nanargmax(np.abs(readings.temperature)))
    if abs(readings.temperature[i]) > _HOTTEST:
        raise InputError(
            f"{readings.where(i)}: temperature is {readings.temperature[i]:g}; expected °C. Is it in kelvin? Subtract 273.15"
        )


def _check_zeros(readings: ObservationSet, campaign: Campaign) -> None:
    """Raises `InputError` for lengths from a station that are exactly 0 again and again: no beam, no reading.

    An instrument that is zeroed once per segment, and comes back to where that was, reads 0 a few times.
    """
    if takes_large_errors(readings) or not any(True for _ in KINDS[readings.kind].beams(readings, campaign)):
        return
    rows = np.flatnonzero(readings.readings[:, 0] == 0.0)
    segments = len(
        np.unique(np.char.add(readings.labels["station"].astype(str), readings.labels["segment"].astype(str)))
    )
    places = len(np.unique(np.round(readings.positions[rows], 3), axis=0))
    if places > _ZEROS * max(segments, 1):
        raise InputError(
            f"{_name_rows(readings, rows)}: the reading is exactly 0 at {places} different positions; was the beam lost? Leave "
            "such rows out"
        )


def _check_labels(readings: ObservationSet) -> None:
    for label, expected in KINDS[readings.kind].choices.items():
        strange = ~np.isin(readings.labels[label], expected)
        if strange.any():
            i = int(np.argmax(strange))
            found = readings.labels[label][i]
            raise InputError(f"{readings.where(i)}: {label} is '{found}'; expected one of {', '.join(expected)}")


def _name_rows(readings: ObservationSet, rows: np.ndarray) -> str:
    """File and line numbers: "volume.csv, rows 2, 3, 4, 5, 6 and 20 more"."""
    numbers = rows + 1 if readings.rows is None else readings.rows[rows]
    named = ", ".join(str(int(n)) for n in numbers[:_ROWS_NAMED])
    more = f" and {len(rows) - _ROWS_NAMED} more" if len(rows) > _ROWS_NAMED else ""
    return f"{readings.source or readings.name}, row{'s' if len(rows) > 1 else ''} {named}{more}"


def _small_positions(readings: ObservationSet, machine: Machine) -> Iterable[str]:
    if positions_look_small(readings, machine):
        where = readings.file_and_set
        yield f"{where}: all positions lie within 2 % of the travels around zero; are they in mm?"


def _outside_travel(readings: ObservationSet, machine: Machine) -> Iterable[str]:
    for i, axis in enumerate(machine.axes):
        q, (lower, upper) = readings.side_by_side.positions[:, i :: len(machine.axes)], axis.travel
        slack = 1e-9 * axis.length
        outside = (q < lower - slack) | (q > upper + slack)
        rows, q = np.flatnonzero(outside.any(axis=1)), q[outside]
        if len(rows):
            found = f"{q.min():g}" if len(q) == 1 else f"{q.min():g} … {q.max():g}"
            yield (
                f"{_name_rows(readings, rows)}: {axis.letter} = {found} {axis.unit} lies outside the travel "
                f"{lower:g} … {upper:g}; the error functions are not determined there"
            )


def _duplicates(readings: ObservationSet, machine: Machine) -> Iterable[str]:
    """Rows that repeat an earlier one in everything, the reading and the time included.

    Raises `InputError` when there are more of them than coarse digits explain; otherwise a warning names them. A reading of
    exactly 0 repeats whenever an instrument is zeroed, and the last row may repeat the first where a path is closed.
    """
    columns = [*(column for values in readings.side_by_side for column in values.T), *readings.readings.T]
    columns += [*readings.labels.values(), *([] if readings.time is None else [readings.time])]
    ids = combine(columns)
    first = first_of(ids, np.arange(len(ids)))
    rows = np.flatnonzero(first != np.arange(len(ids)))
    if not len(rows):
        return
    numbers = np.arange(1, len(ids) + 1) if readings.rows is None else readings.rows
    closing = (rows == len(ids) - 1) & (first[rows] == 0)
    counted = rows[(readings.readings[rows] != 0.0).any(axis=1) & ~closing]
    if len(counted) > _COINCIDENCES * _expected_coincidences(readings, machine):
        later, earlier = int(numbers[counted[0]]), int(numbers[first[counted[0]]])
        others = f", and {len(counted) - 1} more such rows" if len(counted) > 1 else ""
        raise InputError(
            f"{readings.source or readings.name}, rows {earlier} and {later}: the same row twice{others}; remove one, "
            "or, if it was really measured twice, add a `time` column"
        )
    yield f"{_name_rows(readings, rows)}: equal to an earlier row; taken as repeated readings"


def _expected_coincidences(readings: ObservationSet, machine: Machine) -> float:
    """Number of repeated readings expected to agree in all digits: n · resolution / RMS of the differences."""
    later, earlier = repeats(readings, machine)
    differences = np.abs(readings.readings[later] - readings.readings[earlier])
    differences = differences[differences > 0.0]
    if not len(differences):
        return 0.0
    spread = rms(differences)
    return len(later) * min(1.0, _common_step(differences[:_STEPS_TRIED], _CONTINUOUS * spread) / spread)


def _common_step(values: np.ndarray, tolerance: float) -> float:
    """Number that divides all values within the tolerance (Euclid's algorithm): the resolution of an instrument."""
    step = 0.0
    for value in values.tolist():
        while value > tolerance:
            step, value = value, abs(step - value * round(step / value))
    return step


def closures(campaign: Campaign) -> tuple[Closure, ...]:
    """How well readings repeat at the same place: one summary per set and reading column that has repeated readings.

    Readings are at the same place when they have the same labels (station, segment, line …), axis positions within 1 µm or
    1e-6°, the same tool vector, and the same approach direction. The difference is later - earliest, in the order of time where
    every row has one, else of the file; its u takes the two readings as independent. Sphere centres (displacements that are all
    0) repeat at the same rotary positions; for them the nominal places of the centre in the workpiece frame are compared.

    Args:
        campaign: A campaign with readings.

    Returns:
        A tuple of records with `n` differences, their `rms`, `max` and `u` in the unit of the reading, and the ratios to u.

    >>> import volid
    >>> first = volid.closures(volid.load_campaign("datasets/vertical_multilateration/campaign.toml"))[0]
    >>> first.reading, first.n > 0, first.rms_ratio < 2.0
    ('distance', True, True)
    """
    result: list[Closure] = []
    for readings in campaign.sets:
        readings = centres_as_readings(readings, campaign.machine)
        later, earlier = repeats(readings, campaign.machine)
        columns = KINDS[readings.kind].readings
        result += [_closure(readings, i, name, later, earlier) for i, name in enumerate(columns) if len(later)]
    return tuple(result)


def _closure(readings: ObservationSet, i: int, name: str, later: np.ndarray, earlier: np.ndarray) -> Closure:
    drift = readings.readings[later, i] - readings.readings[earlier, i]
    u = np.hypot(readings.u[later, i], readings.u[earlier, i])
    ratio = drift / u
    worst = int(np.argmax(np.abs(drift)))
    numbers = np.arange(1, len(readings) + 1) if readings.rows is None else readings.rows
    return Closure(
        set=readings.name,
        reading=name,
        n=len(later),
        rms=rms(drift),
        max=float(drift[worst]),
        u=rms(u),
        rms_ratio=rms(ratio),
        max_ratio=float(ratio[np.argmax(np.abs(ratio))]),
        rows=(int(numbers[earlier[worst]]), int(numbers[later[worst]])),
    )
