"""Alternatives in the chain: another order or side of the axes, with the same nominal positions."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from volid.campaign import Campaign, ObservationSet
from volid.fitting.diagnosis.alternatives.refits import Other
from volid.model.machine import Machine, parse_structure

ORDER = "order or side of the axes"


def other_orders(campaign: Campaign) -> Iterator[Other]:
    """Every single mistake in the order of the axes."""
    machine = campaign.machine
    for codes in other_structures(machine.structure):
        changed = _restructured(machine, codes[0])
        columns = [machine.index(letter) for letter in changed.letters]
        order, now = ", ".join(changed.letters), ", ".join(machine.letters)
        what = f"the axes stand in the order {order} from workpiece to tool, not {now}"
        others = f" (or, with b elsewhere, {', '.join(codes[1:])})"
        sets = tuple(_reordered(s, columns) for s in campaign.sets)
        moved = replace(campaign, machine=changed, sets=sets)
        yield Other(ORDER, what, f'machine file: structure = "{codes[0]}"{others}', moved)


def _plain(structure: str) -> str:
    return structure.strip().removeprefix("[").removesuffix("]").strip()


def other_structures(structure: str) -> Iterator[list[str]]:
    """Structural codes with one axis at another place of the chain, or two exchanged, in groups of one order of the letters.

    Codes with one order of the letters have the same error motions, whichever side of the bed an axis stands on: nothing tells
    them apart. The first code of a group has the fewest axes on the other side.

    >>> list(other_structures("w X' b Y t"))
    [['w b Y X t', "w Y' X' b t", "w Y' b X t"]]
    """
    tokens = _plain(structure).split()
    bed = tokens.index("b")
    spindle = [t for t in tokens if t.startswith("(")]
    axes = [t for t in tokens[1:-1] if t != "b" and not t.startswith("(")]
    primed, seen = {t[0] for t in tokens[1:bed]}, {tuple(t[0] for t in axes)}
    for order in _orders([t[0] for t in axes]):
        if order not in seen:
            seen.add(order)
            yield [_code(order, k, spindle) for k in _beds(order, primed)]


def _beds(order: tuple[str, ...], primed: set[str]) -> list[int]:
    """How many axes may carry the workpiece, those numbers first for which the fewest axes change their side."""
    return sorted(range(len(order) + 1), key=lambda k: sum((a in primed) != (i < k) for i, a in enumerate(order)))


def _code(order: tuple[str, ...], count: int, spindle: list[str]) -> str:
    return " ".join(["w", *(f"{a}'" for a in order[:count]), "b", *order[count:], *spindle, "t"])


def _orders(letters: list[str]) -> Iterator[tuple[str, ...]]:
    """Two axes exchanged, neighbours first; then one axis moved."""
    n = len(letters)
    for gap in range(1, n):
        for i in range(n - gap):
            order = letters.copy()
            order[i], order[i + gap] = order[i + gap], order[i]
            yield tuple(order)
    for i in range(n):
        rest = letters[:i] + letters[i + 1 :]
        for j in range(n):
            yield (*rest[:j], letters[i], *rest[j:])


def _reordered(s: ObservationSet, columns: list[int]) -> ObservationSet:
    return s.moved(lambda q: q[:, columns], lambda way: way[:, columns])


def _restructured(machine: Machine, structure: str) -> Machine:
    sides = parse_structure(structure)
    axes = tuple(replace(machine.axis(letter), primed=primed) for letter, primed in sides)
    return replace(machine, structure=structure, axes=axes)
