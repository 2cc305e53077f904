"""What cannot be right in an environment: unknown columns, another unit, a clock that goes back, keys that contradict."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping

import numpy as np

from volid.campaign import AIR, TIME, Campaign, Environment
from volid.effects.environment.factors import INDEX, factors_of
from volid.effects.environment.matching import DEGREES_C, OWN, column_of, matched
from volid.exceptions import InputError
from volid.observations import KINDS

WAVELENGTHS = (300.0, 1690.0)  # nm, of Ciddor's equations
MOST_CO2 = 2000.0  # ppm, likewise
EXPANSIONS = (0.0, 1e-4)  # 1/K; no solid that machines are made of expands more
INDICES = (1.0, 1.001)  # of air that people breathe
_BOUNDS = {  # lowest and highest value, and its unit
    "air_temperature_C": (-10.0, 50.0, "°C"),
    "pressure_hPa": (500.0, 1200.0, "hPa, as measured and not reduced to sea level"),
    "humidity_percent": (0.0, 100.0, "%"),
}
_MATERIAL = (-20.0, 80.0, "°C")
_OTHER_UNITS = {  # of a column's values: from, to, what they seem to be in
    "pressure_hPa": ((50.0, 130.0, "kPa"), (5e4, 1.3e5, "Pa"), (20.0, 36.0, "inches of mercury"), (0.5, 1.3, "bar")),
    DEGREES_C: ((250.0, 330.0, "kelvin"), (51.0, 110.0, "°F")),
}


def check_environments(campaign: Campaign) -> None:
    """Raises `InputError` for an environment that cannot be right, or does not fit the sets of its campaign."""
    names = Counter(environment.name for environment in campaign.environments)
    twice = [name for name, n in names.items() if n > 1]
    if twice:
        raise InputError(f"{campaign.source}: two environments are called '{twice[0]}'; give each its own name")
    for environment in campaign.environments:
        where = f"{environment.source or campaign.source or 'campaign'}, environment '{environment.name}'"
        _check_log(environment, where)
        _check_keys(environment, where)
        _check_air(environment, where)
        _check_bodies(environment, where)
        known = [s.name for s in campaign.sets]
        for name in environment.sets:
            if name not in known:
                raise InputError(f"{where}: sets names '{name}'; the sets are {', '.join(known)}")
    _check_matches(campaign)


def check_column(
    name: str, values: np.ndarray, where: str, place: Callable[[int], str] = lambda i: f"entry {i + 1}"
) -> None:
    """Raises `InputError` for values of a column that no air or body of a workshop has; `place`: of a value by its number."""
    low, high, unit = _BOUNDS.get(name, _MATERIAL)
    wrong = (values < low) | (values > high)
    if wrong.any():
        i = int(np.argmax(wrong))
        seems = _seems(name, float(values[i]))
        raise InputError(f"{where}, {place(i)}: {name} is {values[i]:g}{seems}; expected {low:g} … {high:g} {unit}")
    if name == "humidity_percent" and 0.0 < np.nanmax(values, initial=0.0) <= 1.0:
        raise InputError(
            f"{where}: {name} is at most {np.nanmax(values):g}, which seems to be a fraction; expected percent, such as 45"
        )


def _seems(name: str, value: float) -> str:
    found = _OTHER_UNITS.get(name, _OTHER_UNITS[DEGREES_C] if name.endswith(DEGREES_C) else ())
    return next((f", which seems to be in {unit}" for low, high, unit in found if low <= value <= high), "")


def _check_log(environment: Environment, where: str) -> None:
    log, lengths = environment.log, {len(values) for values in environment.log.values()}
    columns = [name for name in log if name != TIME]
    strange = [name for name in columns if name not in AIR and not name.endswith(DEGREES_C)]
    if strange:
        raise InputError(
            f"{where}: column '{strange[0]}' is unknown; expected {', '.join((TIME, *AIR))}, and temperatures of materials "
            "such as material_1_C"
        )
    if not columns or len(lengths) != 1 or 0 in lengths or (TIME not in log and lengths != {1}):
        raise InputError(f"{where}: expected columns of one length with entries, and time where there is more than one")
    for name in columns:
        if not np.isfinite(log[name]).any() or np.isinf(log[name]).any():
            raise InputError(f"{where}: {name} has no finite entry, or an infinite one; expected numbers")
        check_column(name, log[name], where)
    _check_time(log, where)


def _check_time(log: Mapping[str, np.ndarray], where: str) -> None:
    if TIME not in log:
        return
    if not np.isfinite(log[TIME]).all():
        i = int(np.argmax(~np.isfinite(log[TIME])))
        raise InputError(f"{where}, entry {i + 1}: there is no time; expected one in every row of a log")
    back = np.diff(log[TIME]) < 0.0
    if back.any():
        i = int(np.argmax(back))
        raise InputError(
            f"{where}, entry {i + 2}: time goes back by {log[TIME][i] - log[TIME][i + 1]:g} s; expected entries in the order "
            "of time. Was the clock set back, or are days or two logs mixed up?"
        )


def _check_keys(environment: Environment, where: str) -> None:
    for name, value, (low, high) in (
        ("wavelength", environment.wavelength, WAVELENGTHS),
        ("co2", environment.co2, (0.0, MOST_CO2)),
        ("longest_gap", environment.longest_gap, (0.0, np.inf)),
        ("beyond", environment.beyond, (0.0, np.inf)),
    ):
        if not low <= value <= high:
            raise InputError(f"{where}: {name} is {value:g}; expected {low:g} … {high:g}")
    known = [name for name in environment.log if name != TIME] + [OWN]
    for name, value in environment.u.items():
        if name not in known or not value > 0.0:
            raise InputError(
                f"{where}: u states {name} = {value:g}; expected a standard uncertainty > 0 of {', '.join(known)}"
            )


def _check_air(environment: Environment, where: str) -> None:
    there = [name for name in AIR if name in environment.log]
    if there and len(there) < len(AIR):
        missing = ", ".join(name for name in AIR if name not in there)
        raise InputError(
            f"{where}: there is no {missing}; the refractive index takes {', '.join(AIR)}. Add a column, or values = {{ … }} "
            "for what stayed the same"
        )
    if environment.has_air and environment.corrected is None:
        raise InputError(
            f"{where}: corrected is missing; expected true if the readings hold the refractive correction already (as an "
            "instrument with a compensation unit gives them), false if volid is to apply it"
        )
    if environment.at and (not environment.has_air or environment.corrected):
        raise InputError(
            f"{where}: at states a correction to be undone; expected corrected = false and a log of the air beside it"
        )
    _check_at(environment.at, where)
    if not (environment.has_air or environment.machine or environment.artefact):
        raise InputError(
            f"{where}: nothing is asked of it; expected {', '.join(AIR)}, or machine or artefact = {{ … }}"
        )


def _check_at(at: Mapping[str, float], where: str) -> None:
    if not at or set(at) == {INDEX}:
        if at and not INDICES[0] <= at[INDEX] <= INDICES[1]:
            raise InputError(f"{where}, at: {INDEX} is {at[INDEX]:g}; expected that of air, such as 1.0002714")
        return
    if set(at) != set(AIR):
        raise InputError(f"{where}, at: has {', '.join(at)}; expected {', '.join(AIR)}, or {INDEX}")
    for name, value in at.items():
        check_column(name, np.array([value]), f"{where}, at", lambda i: "value")


def _check_bodies(environment: Environment, where: str) -> None:
    for name, body in (("machine", environment.machine), ("artefact", environment.artefact)):
        if body is None:
            continue
        if not EXPANSIONS[0] < body.expansion <= EXPANSIONS[1]:
            raise InputError(
                f"{where}, {name}: expansion is {body.expansion:g}; expected 1/K, such as 11.5e-6 for steel"
            )
        if not 0.0 <= body.u <= body.expansion:
            raise InputError(
                f"{where}, {name}: u is {body.u:g}; expected that of the coefficient, in 1/K, such as 1e-6"
            )
        column = column_of(environment, body)
        if body.u and column not in environment.u:
            raise InputError(
                f"{where}, {name}: u of the coefficient is stated, but not that of {column}; add u = {{ {column} = 0.2 }} (°C)"
            )


def _check_matches(campaign: Campaign) -> None:
    """Raises `InputError` where a log has no entry for a reading, or a key is for another kind."""
    for match in matched(campaign).values():
        factors_of(match)
        if match.environment.dead_path and len(KINDS[match.observations.kind].readings) > 1:
            raise InputError(
                f"{match.where}: dead_path is for single lengths; coordinates count from the instrument, leave it out"
            )
