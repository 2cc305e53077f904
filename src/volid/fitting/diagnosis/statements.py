"""What the data do not determine, in words: functions and combinations, each with the likely reason."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from volid.campaign import Campaign
from volid.model.error_functions import motion_names, settings_for
from volid.model.error_model import LOCATION, REVERSAL, WAVES, ErrorModel
from volid.model.iso230 import SPINDLE, parse
from volid.model.machine import Machine
from volid.observations import KINDS, sets_by_kind

NAMED = 1e-4  # squared component of the null space from which a function is part of it

PART_OF_WEAK = 0.01  # the same, of what is weakly determined
FEWEST = 5  # positions of an axis, below which too few may be the reason


class _Group(NamedTuple):
    """Functions that share parameters: their part, how many parameters, and how many directions of these are not determined."""

    names: tuple[str, ...]
    part: str
    size: int
    share: float

    @property
    def is_open(self) -> bool:
        """Whether nothing of it is determined."""
        return self.share > self.size - NAMED

    @property
    def is_partly_open(self) -> bool:
        """Whether it takes part in combinations that are not determined, but is not entirely so."""
        return NAMED < self.share <= self.size - NAMED

    @property
    def setting(self) -> str:
        """What in the machine file takes the first of the functions out of the model."""
        return f"{self.names[0]} = {{ reversal = false }}" if self.part == REVERSAL else f"{self.names[0]} = false"

    def text(self, with_size: bool = False) -> str:
        """The names, and how many coefficients where there are several."""
        named = ", ".join(self.names) + (f" {self.part}" if self.part in (REVERSAL, WAVES) else "")
        return f"{named} (all {self.size} coefficients)" if with_size and self.part != LOCATION else named


def _groups(model: ErrorModel, null: np.ndarray) -> list[_Group]:
    return [
        _Group(names, part, p.stop - p.start, float(np.sum(null[p] ** 2)) if null.size else 0.0)
        for names, part, p in model.groups
    ]


def involvement(model: ErrorModel, null: np.ndarray) -> dict[str, float]:
    """Number of directions that are not determined inside each function (or coupled group), by name and part.

    It is the trace of the null projector's block; `null` has orthonormal columns in physical units.
    """
    concerned = [g for g in _groups(model, null) if g.share > NAMED]
    return {f"{n} {g.part}" if g.part in (REVERSAL, WAVES) else n: g.share for g in concerned for n in g.names}


def explain(model: ErrorModel, null: np.ndarray, campaign: Campaign, tool_fixed: bool = False) -> tuple[str, ...]:
    """The null space in words: first functions that are not determined at all, then combinations, each with a reason.

    Where nothing of an axis is determined, the last statement names the functions of the other axes that are.
    `tool_fixed`: constants of the tool frame are held at 0 besides.
    """
    if not null.size:
        return ()
    groups = _groups(model, null)
    place = [g for g in groups if g.is_open and _is_place_of_workpiece(campaign, g)]
    wholly = [g for g in groups if g.is_open and g not in place]
    count = null.shape[1] - sum(g.size for g in (*place, *wholly))
    reason = _reason(model, null, campaign)
    lines = [_place_line(place, campaign)] if place else []
    lines += [_open_line(wholly, reason)] if wholly else []
    lines += _combination_lines(groups, count, reason)
    if tool_fixed and place and len(lines) == 1:
        lines.append(f"Constants of the tool frame, held at 0: {reason}.")
    return (*lines, *_determined_lines(groups))


class Weak(NamedTuple):
    """Functions that are determined only weakly: their symbols, and what in the campaign makes it so."""

    names: tuple[str, ...]
    reason: str


def explain_weak(model: ErrorModel, weak: np.ndarray, campaign: Campaign) -> tuple[Weak, ...]:
    """What is determined only weakly, (n, d) in physical units, and the reading that would help; nothing where all is well."""
    concerned = [g for g in _groups(model, weak) if g.share > PART_OF_WEAK] if weak.size else []
    if not concerned:
        return ()
    names = tuple(dict.fromkeys(n for g in concerned for n in g.names))
    reason = "; ".join(likely_reasons(campaign))
    return (Weak(names, reason or "tool vectors or stations that differ more would separate them"),)


def _place_line(place: list[_Group], campaign: Campaign) -> str:
    named = ", ".join(g.text() for g in place)
    return (
        f"{named}: same as the unknown place of the {_standing(campaign)} on the workpiece. No reading tells them "
        f"apart, and no compensation needs them; set {place[0].setting} and the like."
    )


def _open_line(groups: list[_Group], reason: str) -> str:
    named = ", ".join(g.text(with_size=True) for g in groups)
    return f"{named}: {reason}. Measure what is missing, or set {groups[0].setting} and the like."


def _combination_lines(groups: list[_Group], count: int, reason: str) -> list[str]:
    """The `count` combinations of functions that are not determined, where there are any."""
    among = ", ".join(g.text() for g in groups if g.is_partly_open)
    return [f"{count} combination{'s' if count > 1 else ''} among {among}: {reason}."] if among and count else []


def _determined_lines(groups: list[_Group]) -> list[str]:
    """What is determined of the other axes, when nothing is determined of one."""
    of_axis: dict[str, list[_Group]] = {}
    for g in groups:
        of_axis.setdefault(parse(g.names[0]).axis, []).append(g)
    missing = [a for a, found in of_axis.items() if a != SPINDLE and all(g.is_open for g in found)]
    known = [g.text() for a, found in of_axis.items() if a not in missing for g in found if g.share <= NAMED]
    return [f"Without {', '.join(missing)}, these are determined: {', '.join(known)}."] if missing and known else []


def _is_place_of_workpiece(campaign: Campaign, group: _Group) -> bool:
    """Whether a constant translates a head: with spheres alone, their unknown places are the same."""
    error, machine = parse(group.names[0]), campaign.machine
    if group.part != LOCATION or error.is_rotation or error.axis not in machine.letters:
        return False
    axis = machine.axis(error.axis)
    return not axis.is_linear and not axis.primed and all(KINDS[s.kind].standing for s in campaign.sets)


def _reason(model: ErrorModel, null: np.ndarray, campaign: Campaign) -> str:
    concerned = [f.name for f in model.functions if f.part != LOCATION and np.sum(null[f.parameters] ** 2) > NAMED]
    reasons = [*_segment_reasons(model, campaign, concerned), *likely_reasons(campaign)]
    return (
        "; ".join(reasons)
        or "the readings do not separate them; stations, tool vectors or positions that differ more would"
    )


def _standing(campaign: Campaign) -> str:
    """What stands on the workpiece at an unknown place, in words."""
    return " or ".join(dict.fromkeys(KINDS[s.kind].standing for s in campaign.sets))


def _segment_reasons(model: ErrorModel, campaign: Campaign, names: list[str]) -> list[str]:
    """Splines with more stated coefficients than there are positions of their axis, among the functions `names`."""
    reasons = []
    names = [n for n in names if settings_for(campaign.machine, n).segments != "auto"]
    for letter in campaign.machine.letters:
        values = campaign.positions[:, campaign.machine.index(letter)]
        count = len(np.unique(np.round(values, 3)))
        sizes = [s for f in model.functions if f.name in names for s in f.splines]
        sizes = [s for s in sizes if campaign.machine.letters[s.axis] == letter and s.size > count]
        if sizes:
            worst = max(sizes, key=lambda s: s.size)
            reasons.append(
                f"{worst.segments} segments on axis {letter} need at least {worst.size} positions and {count} were measured; "
                'take fewer segments (or "auto") or more positions'
            )
    return reasons


def likely_reasons(campaign: Campaign) -> list[str]:
    """Facts about a campaign because of which functions are often not determined: tool vectors, stations, positions."""
    reasons = _by_kind(campaign)
    for i, letter in enumerate(campaign.machine.letters):
        values = campaign.positions[:, i]
        count = len(np.unique(np.round(values, 3)))
        ways = set(np.unique(np.concatenate([s.all_ends.directions[:, i] for s in campaign.sets])).tolist()) - {0}
        if len(ways) < 2 and any(f.axis == letter for f in map(parse, reversals(campaign.machine))):
            said = "in one direction only" if ways else "without recorded directions"
            reasons.append(
                f"axis {letter} was approached {said} (column {letter}_dir); approach its positions from both"
            )
        if count < FEWEST:
            measured = f"{count} position{'s' if count > 1 else ''}"
            reasons.append(f"axis {letter} was measured at {measured} only; measure {FEWEST} or more over its travel")
    return list(dict.fromkeys(reasons))


def _by_kind(campaign: Campaign) -> list[str]:
    """What every kind says of its sets, which are named where it does not hold for all sets; kinds may say the same."""
    said: dict[str, list[str]] = {}
    for kind, sets in sets_by_kind(campaign).items():
        for text in kind.advice(sets, campaign):
            said.setdefault(text, []).extend(s.name for s in sets)
    everywhere = len(campaign.sets)
    return [
        text if len(names) == everywhere else f"in set {', '.join(map(repr, names))}: {text}"
        for text, names in said.items()
    ]


def reversals(machine: Machine) -> list[str]:
    """Error motions that the machine file models with reversal."""
    return [name for name in motion_names(machine) if settings_for(machine, name).reversal]
