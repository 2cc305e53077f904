"""Diagonal displacement tests after ISO 230-6: deviations along body and face diagonals, evaluated as along an axis (ISO 230-2).

Targets are distances from the start of a diagonal, deviations displacement - distance, "up" is the way on from the start. Of each
diagonal `E_PPP` is the range of the mean deviations of both ways, `R_PPP` the repeatability, `B_PPP` the largest reversal;
`E_d`, `R_d` and `B_d` are the largest of the diagonals. Body diagonals are named by the sense of X, Y and Z, P or N, face
diagonals by plane and senses, as XY_NP; one that was run the other way round (NNN) counts as its opposite (PPP).

A diagonal mixes errors: one scale s of X changes it by s (X/L)² of its length L, a squareness of X and Y by the product of their
shares, and opposite errors hide each other, so that small diagonals do not prove a small volumetric error. Of a set of
sequential step diagonals the readings on the diagonals count. Not modelled: drift between diagonals. Source: ISO 230-6:2002.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from volid.campaign import Campaign, ObservationSet
from volid.effects.environment.reduction import reduced
from volid.exceptions import InputError
from volid.model.iso230 import LINEAR_AXES
from volid.observations.base import Positioning
from volid.observations.beam_lines import BeamLine, beams_of
from volid.observations.beam_unknowns import uninterrupted
from volid.standards.positioning.runs import Approaches, PositioningRuns, arranged, run_numbers
from volid.standards.positioning.sets import contributions_of_line
from volid.standards.positioning.uncertainty import Contribution
from volid.standards.shared_errors import corrections

BODY_NAMES = ("PPP", "NPP", "PNP", "PPN")
FACE_NAMES = tuple(f"{plane}_{senses}" for plane in ("XY", "XZ", "YZ") for senses in ("PP", "NP"))
ON_LINE = 0.01  # mm beside the diagonal: farther away a reading is none of it
SHORT = 1e-3  # share of a diagonal: an axis that goes less far stands still


class Diagonal(NamedTuple):
    """Runs along one diagonal. `name`: as ISO 230-6 calls it, with what the set adds where there are several; `is_body`: of the
    box, not of a face; `contributions`: what makes the test uncertain."""

    name: str
    is_body: bool
    runs: PositioningRuns
    contributions: tuple[Contribution, ...] = ()


def diagonals_of(campaign: Campaign, sets: Sequence[str] | None = None) -> dict[str, list[Diagonal]]:
    """The diagonals among the beams of a campaign, by set.

    Args:
        campaign: A campaign with readings; its environment's corrections are applied.
        sets: Names of sets; None: all.

    Raises:
        InputError: a set of that name is not there, or no beam runs along a diagonal.

    >>> import volid
    >>> from volid.planning.diagonals import diagonals
    >>> plan = diagonals(volid.load_machine("models/wYXbZt_vertical.toml"), 5)
    >>> campaign, _ = volid.simulate(plan, seed=1)
    >>> [d.name for d in diagonals_of(campaign)["diagonals"]][:5]
    ['PPP', 'NPP', 'PNP', 'PPN', 'XY_PP']
    """
    campaign = reduced(campaign)
    names = [s.name for s in campaign.sets]
    for name in sets or ():
        if name not in names:
            raise InputError(f"{campaign.source}: there is no set '{name}'; expected one of {', '.join(names)}")
    found = {
        s.name: list(_of_set(s, campaign)) for s in campaign.sets if s.name in (sets or names) and "lines" in s.options
    }
    found = {name: _apart(diagonals) for name, diagonals in found.items() if diagonals}
    if not found:
        raise InputError(
            f"{campaign.source}: no beam runs along a body or face diagonal; expected lines such as PPP or XY_NP"
        )
    return found


def standard_name(senses: Mapping[str, float]) -> tuple[str, float]:
    """The name of a diagonal, and +1, or -1 where it is run against its name; `senses`: of the axes that move, by letter.

    >>> standard_name({"X": -1.0, "Y": -1.0, "Z": 1.0}), standard_name({"Y": 1.0, "Z": -1.0})
    (('PPN', -1.0), ('YZ_NP', -1.0))
    """
    letters = [a for a in LINEAR_AXES if a in senses]
    for sign in (1.0, -1.0):
        text = "".join("P" if sign * senses[a] > 0.0 else "N" for a in letters)
        name = text if len(letters) == 3 else f"{''.join(letters)}_{text}"
        if name in BODY_NAMES + FACE_NAMES:
            return name, sign
    raise InputError(f"{', '.join(letters) or 'no axis'}: no diagonal; expected two or three of X, Y, Z")


def _of_set(observations: ObservationSet, campaign: Campaign) -> Iterator[Diagonal]:
    for line in beams_of(observations, campaign):
        senses = _senses(line)
        if len(senses) > 1:
            name, sign = standard_name(senses)
            yield _diagonal(line, campaign, name, sign)


def _senses(line: BeamLine) -> dict[str, float]:
    """Which linear axes move along the beam's direction, and in which sense; none where one moves alone."""
    far = int(np.argmax(np.abs(line.nominal)))
    machine, q = line.machine, line.seen.positions
    moved = {a: float(q[far, machine.index(a)] - q[0, machine.index(a)]) for a in LINEAR_AXES if a in machine.letters}
    longest = max((abs(v) for v in moved.values()), default=0.0)
    forward = float(np.sign(line.nominal[far]))
    return {a: forward * float(np.sign(v)) for a, v in moved.items() if abs(v) > SHORT * longest > 0.0}


def _diagonal(line: BeamLine, campaign: Campaign, name: str, sign: float) -> Diagonal:
    """Readings on the diagonal, from its start as its name has it."""
    own = line.observations
    on = np.flatnonzero(line.beside < ON_LINE)
    start = line.nominal[on].min() if sign > 0.0 else line.nominal[on].max()
    target = sign * (line.nominal[on] - start)
    deviation = sign * (line.seen.readings[on, 0] - line.nominal[on])
    rows, ways = line.rows[on], sign * _ways(line)[on]
    run = own.labels["run"][rows].astype(str).tolist()
    if len(set(run)) == 1:
        run = run_numbers(target, ways, "mm")
    places = [own.where(int(i)) for i in rows]
    approaches = Approaches(target, ways, run, deviation - deviation[int(np.argmin(target))], places)
    notes = (*_notes(len(uninterrupted(line))), *corrections(own, rows), *campaign.warnings)
    runs = arranged(name, approaches, source=f"{own.file_and_set}, line {line.name}", notes=notes)
    numbered = approaches._replace(deviation=np.arange(len(rows), dtype=float))
    read = Positioning(line.name, -1, rows, deviation, sign, len(uninterrupted(line)))
    found = contributions_of_line(own, campaign, read, arranged(name, numbered).deviations)
    return Diagonal(name, name in BODY_NAMES, runs, tuple(found))


def _notes(zeros: int) -> tuple[str, ...]:
    """What is to be said of an interferometer that was set to zero more than once along a diagonal."""
    if zeros == 1:
        return ()
    return (
        f"the interferometer was set to zero {zeros} times along a diagonal; every zero is taken as it was read, so that "
        "R and B hold for what happened after it",
    )


def _ways(line: BeamLine) -> np.ndarray:
    """+1 where a row is approached along the beam, -1 against it, (m,): by the directions of the axes, or by the row before."""
    machine = line.machine
    directions = line.seen.directions[:, [machine.index(a) for a in LINEAR_AXES if a in machine.letters]]
    senses = _senses(line)
    axis = [a for a in LINEAR_AXES if a in machine.letters].index(next(iter(senses)))
    stated = directions[:, axis] * next(iter(senses.values()))
    moved = np.sign(np.diff(line.nominal, prepend=np.nan))
    moved[0] = moved[1] if len(moved) > 1 else 1.0
    for i in np.flatnonzero(moved == 0.0):  # where the tool turns back, the way after it
        moved[i] = moved[i + 1] if i + 1 < len(moved) else moved[i - 1]
    return np.where(stated != 0.0, stated, moved)


def _apart(found: list[Diagonal]) -> list[Diagonal]:
    """Diagonals of one name numbered: PPP, PPP_2, …"""
    seen: dict[str, int] = {}
    result = []
    for d in found:
        seen[d.name] = seen.get(d.name, 0) + 1
        result.append(d if seen[d.name] == 1 else d._replace(name=f"{d.name}_{seen[d.name]}"))
    return result
