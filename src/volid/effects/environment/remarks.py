"""What was done to the readings of every set, in numbers and in words, and what is odd about it."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from volid.campaign import AIR, Campaign
from volid.effects.environment.factors import REFERENCE_TEMPERATURE, TYPICAL_U, Factors, factors_of, u_of_index
from volid.effects.environment.matching import Matched, matched
from volid.observations import KINDS
from volid.observations.base import EITHER, LIGHT

MERCURY = (650.0, 790.0)  # hPa: 2000 to 3500 m above the sea, or mm of mercury


def accounts(campaign: Campaign) -> list[dict[str, Any]]:
    """For every set with an environment: what acts on its lengths and by how much, each as [lowest, highest].

    `refraction`: relative change of lengths by the air (`applied`, or said to have been applied by the instrument); `undone`:
    that of the correction that was undone first; `refractivity`: n - 1; `u_refraction`: of n, by the stated u or, where none is
    stated, by that of usual sensors (`u_stated`). `machine`, `artefact`: their temperatures [°C] and the relative change of
    lengths.
    """
    return [_account(match, factors_of(match)) for match in matched(campaign).values()]


def _account(match: Matched, factors: Factors) -> dict[str, Any]:
    environment = match.environment
    found: dict[str, Any] = {"set": match.observations.name, "environment": environment.name}
    found |= {"log": environment.source, "lengths": match.medium, "refractivity": None}
    if factors.refractivity is not None:
        stated = {name: u for name, u in environment.u.items() if name in AIR}
        found |= {
            "refractivity": _span(factors.refractivity),
            "refraction": _span(1.0 / (1.0 + factors.refractivity) - 1.0),
            "undone": factors.given - 1.0,
            "applied": not environment.corrected,
            "u_stated": bool(stated),
            "u_refraction": u_of_index(environment, stated or TYPICAL_U),
        }
    for name, body in match.bodies.items():
        temperature = factors.temperatures[name]
        sign = -1.0 if name == "machine" else 1.0
        change = (1.0 + body.expansion * (temperature - REFERENCE_TEMPERATURE)) ** sign - 1.0
        found[name] = {"temperature": _span(temperature), "change": _span(change)}
    return found


def _span(values: np.ndarray) -> list[float]:
    return [float(values.min()), float(values.max())]


def remarks_on(campaign: Campaign) -> tuple[str, ...]:
    """What looks odd about the environments of a campaign, in words, each naming the set."""
    return (
        *_without(campaign),
        *_warm(campaign),
        *(said for match in matched(campaign).values() for said in _remarks(match)),
    )


def _without(campaign: Campaign) -> Iterator[str]:
    """Sets in light for which no environment holds although there are some."""
    found = matched(campaign)
    for s in campaign.sets:
        if (
            s.name not in found
            and KINDS[s.kind].lengths_of(s) == LIGHT
            and any(e.has_air for e in campaign.environments)
        ):
            reason = ", as its readings have no time" if s.time is None else ""
            yield f"set '{s.name}': read in light, and no [[environment]] holds for it{reason}; its readings stay as they are"


def _is_absolute(match: Matched) -> bool:
    """Whether lengths may be absolute ones: coordinates from an instrument, or lengths that may be anything."""
    kind = KINDS[match.observations.kind]
    return len(kind.readings) > 1 or kind.lengths_of(match.observations) == EITHER


def _warm(campaign: Campaign) -> Iterator[str]:
    """Sets of lengths that are not reduced to 20 °C although others are."""
    found = matched(campaign)
    cold = [name for name, match in found.items() if match.environment.machine]
    for s in campaign.sets if cold else ():
        if s.name not in cold and KINDS[s.kind].lengths_of(s):
            yield (
                f"set '{s.name}': its lengths are not at 20 °C, as those of {', '.join(cold)} are; state machine = {{ … }} in "
                "an [[environment]] for it too, unless they hold for 20 °C already"
            )


def _remarks(match: Matched) -> Iterator[str]:
    environment, types = match.environment, [e.type for e in match.observations.effects]
    where = (
        f"set '{match.observations.name}', environment '{environment.name}'"  # no file: notes are kept when files move
    )
    if match.medium == LIGHT and environment.has_air:
        pressure = float(np.nanmean(environment.log["pressure_hPa"]))
        if MERCURY[0] < pressure < MERCURY[1]:
            yield (
                f"{where}: the pressure is {pressure:.0f} hPa, as 2000 to 3500 m above the sea; if it is in mm of "
                "mercury, lengths are wrong by 70 µm/m: multiply it by 1.33322"
            )
        if _is_absolute(match) and not environment.corrected and not environment.group:
            yield (
                f"{where}: ranges are divided by the phase index, as of counted fringes; for an absolute distance meter, whose "
                "light is modulated, state group = true and its wavelength (some µm/m)"
            )
        if any(name in environment.u for name in AIR) and "scale" in types:
            yield f"{where}: the set states an effect of type scale, and the u of the air counts besides it; both once?"
    if match.bodies and environment.u and "temperature" in types:
        yield (
            f"{where}: the set states an effect of type temperature, which counts alone; the u of temperatures and of "
            "expansion that the environment states are not added"
        )
