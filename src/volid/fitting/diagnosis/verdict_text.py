"""The verdict in words, and the groups of readings that it names."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from volid.fitting.diagnosis.adequacy import ACCEPTED, ENLARGED, Adequacy, GroupTest

CERTAIN = 1e-6  # the same, for a verdict that rejects
CONCENTRATED = 1.5  # unit weight of one group over that of all others
PESSIMISTIC = 0.8  # unit weight of readings below which u is said to be too large
FREE = 30  # redundant readings that can say so
WORST = 4  # groups named in the verdict
BARE_U = "times the U that the stated u gives"
ACCEPTED_BUT = "model accepted by the data, though a cause of a small misfit is known"


def concentrated(groups: tuple[GroupTest, ...]) -> list[GroupTest]:
    """Groups whose unit weight is certainly above 1 and far above that of the others of their sort, the largest first."""
    found = []
    for g in groups:
        others = [o for o in groups if o.sort == g.sort and o is not g]
        n = sum(o.n for o in others)
        if not n or g.probability * len(groups) > CERTAIN:
            continue
        rest = float(np.sqrt(sum(o.n * o.unit_weight**2 for o in others) / n))
        if g.unit_weight > CONCENTRATED * max(rest, 1.0):
            found.append(g)
    return sorted(found, key=lambda g: -g.unit_weight)


def power(log10: float) -> str:
    """A probability in words, from its decimal logarithm."""
    return "below 1e-300" if log10 < -300.0 else f"of 1e{log10:.0f}"


def verdict_text(adequacy: Adequacy, reasons: list[str], waves: Mapping[str, float]) -> str:
    """The verdict in words."""
    weight, freedom = adequacy.unit_weight, adequacy.degrees_of_freedom
    if adequacy.grade == ACCEPTED:
        if adequacy.reading_weight < PESSIMISTIC and min(freedom, adequacy.redundancy) > FREE:
            return (
                f"model accepted by the data; unit weight of the readings {adequacy.reading_weight:.2f}: the stated "
                "uncertainties are pessimistic"
            )
        return "model accepted by the data"
    p = adequacy.probability
    chance = f"probability {p:.1e}" if p > 0.0 else "probability below 1e-300"
    if adequacy.grade == ENLARGED:
        sizes = " and ".join(f"{1e3 * u:.2f} µm in {direction}" for direction, u in waves.items())
        by = [f"by the factor {adequacy.factor:.2f}"] if adequacy.factor > 1.0 else []
        by += [f"by waves too short for the functions, of {sizes} (standard deviation)"] if waves else []
        text = f"model accepted by the data, with every u enlarged {' and '.join(by)}" if by else ACCEPTED_BUT
        return f"{text} (unit weight {weight:.2f}, {chance}): there is a misfit, too small to move a result by more than its U"
    text = f"model rejected by the data (unit weight {weight:.2f}, {chance}): {'; '.join(reasons)}"
    where = "; ".join(f"{g.what} (unit weight {g.unit_weight:.2f})" for g in _worst(adequacy.groups))
    text += f"; worst: {where}" if where else ""
    if adequacy.suspects:
        text += f"; {len(adequacy.suspects)} reading(s) beyond the critical value, first {adequacy.suspects[0].where}"
    return text


def _worst(groups: tuple[GroupTest, ...]) -> list[GroupTest]:
    """Groups whose unit weight is far above that of the others, one of each sort."""
    found: dict[str, GroupTest] = {}
    for group in concentrated(groups):
        found.setdefault(group.sort, group)
    return list(found.values())[:WORST]
