"""Which environment holds for which set, and what its log says at the time of every reading."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from volid.campaign import TIME, Campaign, Environment, Expansion, ObservationSet
from volid.exceptions import InputError
from volid.observations import KINDS
from volid.observations.base import ARTEFACT, EITHER, LIGHT

OWN = "temperature"  # as `material`: the column of the readings' own file
DEGREES_C = "_C"


class Matched(NamedTuple):
    """A set with the environment that holds for it, and what its lengths are: `LIGHT` or `ARTEFACT`."""

    observations: ObservationSet
    environment: Environment
    medium: str

    @property
    def where(self) -> str:
        """In messages: "volume.csv, set 'volume', environment 'day'"."""
        return f"{self.observations.file_and_set}, environment '{self.environment.name}'"

    @property
    def bodies(self) -> dict[str, Expansion]:
        """The bodies whose expansion acts on the lengths, by the words for them."""
        given = {"machine": self.environment.machine, "artefact": self.environment.artefact}
        if self.medium == LIGHT:
            del given["artefact"]
        return {name: body for name, body in given.items() if body is not None}


def named_in(environment: Environment, campaign: Campaign) -> list[str]:
    """Names of the sets that an environment holds for: those it names, or all whose lengths it acts on by their own keys."""
    if environment.sets:
        return list(environment.sets)
    acted_on = [LIGHT] if environment.has_air or environment.machine else []
    acted_on += [ARTEFACT] if environment.artefact else []
    return [s.name for s in campaign.sets if KINDS[s.kind].lengths_of(s) in acted_on and _has_time(environment, s)]


def narrowed(campaign: Campaign) -> Campaign:
    """A part of a campaign with those of its environments that hold for its sets, and the names of no others in them."""
    there, found = {s.name for s in campaign.sets}, []
    for environment in campaign.environments:
        kept = tuple(name for name in environment.sets if name in there)
        if kept or not environment.sets:
            found.append(replace(environment, sets=kept))
    return replace(campaign, environments=tuple(found))


def _has_time(environment: Environment, observations: ObservationSet) -> bool:
    return TIME not in environment.log or observations.time is not None


def matched(campaign: Campaign) -> dict[str, Matched]:
    """Sets with their environments, by the set's name. Raises `InputError` for one on which no environment can act, or two do."""
    found: dict[str, Matched] = {}
    sets = {s.name: s for s in campaign.sets}
    for environment in campaign.environments:
        for name in named_in(environment, campaign):
            if name in found:
                raise InputError(
                    f"{found[name].where}: environment '{environment.name}' holds for this set too; expected one environment "
                    "for a set, name their sets by sets = [..]"
                )
            found[name] = Matched(sets[name], environment, _medium(environment, sets[name]))
    return found


def _medium(environment: Environment, observations: ObservationSet) -> str:
    said = KINDS[observations.kind].lengths_of(observations)
    if said == EITHER:
        said = ARTEFACT if environment.artefact and not environment.has_air else LIGHT
    where = f"{observations.file_and_set}, environment '{environment.name}'"
    if not said:
        counts = "interferometer" in KINDS[observations.kind].further
        hint = "; a set that a laser interferometer read along the axis that moves says interferometer = true" * counts
        raise InputError(
            f"{where}: readings of kind '{observations.kind}' are no lengths in light or of an artefact; leave the set out of "
            f"sets{hint}"
        )
    if said == ARTEFACT and not environment.artefact:
        raise InputError(
            f"{where}: its lengths are an artefact's, and the environment does not say how that expands; add artefact = {{ "
            "expansion = …, material = … }, or leave the set out of sets"
        )
    return said


def column_of(environment: Environment, body: Expansion) -> str:
    """The column of the log with the temperature of a body; `OWN` for that of the readings. Raises `InputError` for none."""
    if body.material == OWN:
        return OWN
    known = environment.materials
    for name in (body.material, f"{body.material}{DEGREES_C}") if body.material else known if len(known) == 1 else ():
        if name in known:
            return name
    asked = f"material is '{body.material}'" if body.material else "no material is named"
    raise InputError(
        f"environment '{environment.name}': {asked}, and the log has "
        f'{", ".join(known) or "no temperature of a body"}; expected one of its columns, or material = "{OWN}" for the column '
        "of the readings"
    )


def at_readings(match: Matched, column: str) -> np.ndarray:
    """Values of a column of the log at the times of all readings of a set, (m,), by linear interpolation in time.

    Raises `InputError` naming a reading without time, outside the log, or in too long a gap of it.
    """
    observations, environment = match.observations, match.environment
    if column == OWN:
        return _own(match)
    values = environment.log[column]
    if TIME not in environment.log:
        return np.full(len(observations), float(values[0]))
    known = np.isfinite(values)
    times, values = environment.log[TIME][known], values[known]
    time = _times(match)
    _refuse(match, time < times[0] - environment.beyond, time, times, "before the first entry")
    _refuse(match, time > times[-1] + environment.beyond, time, times, "after the last entry")
    _refuse_gaps(match, column, time, times)
    return np.asarray(np.interp(time, times, values))


def _own(match: Matched) -> np.ndarray:
    values = match.observations.temperature
    if values is None or np.isnan(values).any():
        i = 0 if values is None else int(np.argmax(np.isnan(values)))
        raise InputError(
            f"{match.observations.where(i)}: there is no temperature, which environment '{match.environment.name}' takes from "
            "the readings; expected a column temperature (°C) without gaps, or a material of the log"
        )
    return values


def _times(match: Matched) -> np.ndarray:
    time = match.observations.time
    if time is None or np.isnan(time).any():
        i = 0 if time is None else int(np.argmax(np.isnan(time)))
        raise InputError(
            f"{match.observations.where(i)}: there is no time, and environment '{match.environment.name}' is a log over time; "
            "expected a time for every reading, or leave the set out of sets"
        )
    return time


def _refuse(match: Matched, wrong: np.ndarray, time: np.ndarray, times: np.ndarray, said: str) -> None:
    """Raises `InputError` for readings outside the log."""
    if not wrong.any():
        return
    i = int(np.argmax(wrong))
    away = float(max(times[0] - time[i], time[i] - times[-1]))
    raise InputError(
        f"{match.observations.where(i)} and {int(wrong.sum()) - 1} more: read {away:g} s {said} of environment "
        f"'{match.environment.name}' ({times[0]:.0f} … {times[-1]:.0f} s, readings {time.min():.0f} … {time.max():.0f} s); "
        "expected one clock for both ([csv] time of set and environment) and a log that spans the readings, or beyond = … (s) "
        "for how long its first and last entries hold"
    )


def _refuse_gaps(match: Matched, column: str, time: np.ndarray, times: np.ndarray) -> None:
    """Raises `InputError` for readings between two entries that are too far apart."""
    if len(times) < 2:
        return
    before = np.clip(np.searchsorted(times, time, side="right") - 1, 0, len(times) - 2)
    gap = times[before + 1] - times[before]
    inside = (time > times[before]) & (time < times[before + 1])
    wrong = inside & (gap > match.environment.longest_gap)
    if wrong.any():
        i = int(np.argmax(wrong))
        raise InputError(
            f"{match.observations.where(i)} and {int(wrong.sum()) - 1} more: {column} has no entry for {gap[i]:g} s around it "
            f"in environment '{match.environment.name}'; expected entries at most {match.environment.longest_gap:g} s apart, "
            "or state longest_gap = … (s) if a straight line between them will do"
        )
