"""Whether readings hold the refractive correction as their environment says: it makes 270 µm/m, and the nominal machine tells.

Both ways are tried, and what is adjusted is the same as in `nominal`. Few machines have errors of scale of that size, all axes
alike.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from volid.campaign import Campaign, Environment
from volid.effects.environment.matching import Matched, matched
from volid.effects.environment.reduction import as_read, reduced
from volid.exceptions import InputError
from volid.fitting.nominal import ROWS, few, nominal_misfit
from volid.observations.base import LIGHT, takes_large_errors

BETTER = 0.5  # misfit the other way over that as stated, at most: the errors of the machine are in both
_SEEMS = {
    True: "do not hold the refractive correction, although corrected = true",
    False: "hold the refractive correction already, and corrected = false lets volid apply it again",
}


def check_air(campaign: Campaign) -> None:
    """Raises `InputError` where readings and nominal machine agree much better if the air acts otherwise than stated.

    Sets whose user says `large_errors` are not asked.
    """
    for environment in campaign.environments:
        held = [m for m in matched(campaign).values() if m.environment is environment and m.medium == LIGHT]
        asked = [m for m in held if not takes_large_errors(m.observations)]
        if environment.has_air and asked:
            _check(campaign, environment, asked)


def _check(campaign: Campaign, environment: Environment, asked: list[Matched]) -> None:
    thinned = few(replace(campaign, sets=tuple(m.observations for m in asked)), ROWS)
    names = tuple(m.observations.name for m in asked)
    stated = replace(environment, sets=names)
    other = replace(stated, corrected=not stated.corrected, at={})
    misfit = nominal_misfit(replace(thinned, environments=(stated,)))
    if not np.isfinite(misfit):
        return
    remaining = nominal_misfit(reduced(replace(as_read(thinned), environments=(other,))))
    if remaining > BETTER * misfit:
        return
    raise InputError(
        f"{asked[0].where}: it seems that the readings of {', '.join(names)} {_SEEMS[bool(environment.corrected)]}: they "
        f"disagree with the nominal machine by {misfit:.2g} mm (root mean square) as stated, and by {remaining:.2g} mm the "
        f"other way. What to do: corrected = {str(bool(other.corrected)).lower()} in [[environment]]; if it is right as it "
        "stands, pass `accept_large_errors=True`"
    )
