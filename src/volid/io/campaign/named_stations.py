"""Stations that only the readings name: their places are unknown, on the workpiece. A name that hardly occurs may be misspelt."""

from __future__ import annotations

from collections import Counter

import numpy as np

from volid.campaign import ObservationSet, Station
from volid.io.basics.csv_rows import shown
from volid.io.basics.toml_table import nearest
from volid.observations import KINDS

_FEW = 3  # readings: less than the three coordinates and the dead path of a station need
_SHARE = 0.05  # of the readings that the other stations have


def with_named(
    declared: tuple[Station, ...], sets: tuple[ObservationSet, ...]
) -> tuple[tuple[Station, ...], tuple[str, ...]]:
    """All stations: those declared, then others that readings name, in their order; and remarks on names that hardly occur."""
    known = {station.name for station in declared}
    counts: Counter[str] = Counter()
    first: dict[str, str] = {}
    for readings in sets:
        names, places, numbers = np.unique(
            KINDS[readings.kind].stations_of(readings), return_index=True, return_counts=True
        )
        counts.update(dict(zip(names.tolist(), numbers.tolist(), strict=True)))
        for i in np.argsort(places):
            first.setdefault(str(names[i]), readings.where(int(places[i])))
    named = [name for name in first if name not in known]
    return (*declared, *map(Station, named)), tuple(
        _remark(n, counts, first[n], known) for n in named if _rare(n, counts) or _looks_like(n, counts)
    )


def _looks_like(name: str, counts: Counter[str]) -> bool:
    """Whether another name differs from this one by case and blanks alone, and has more readings."""
    plain = "".join(name.split()).casefold()
    alike = [other for other in counts if other != name and "".join(other.split()).casefold() == plain]
    return any(counts[other] >= counts[name] for other in alike)


def _rare(name: str, counts: Counter[str]) -> bool:
    others = [n for other, n in counts.items() if other != name]
    usual = float(np.median(others)) if others else 0.0
    return counts[name] < usual and counts[name] <= max(_FEW, _SHARE * usual)


def _remark(name: str, counts: Counter[str], where: str, known: set[str]) -> str:
    others = [other for other in counts if other != name and (other in known or counts[other] > counts[name])]
    n = counts[name]
    hint = nearest(name, others) or ";"
    return (
        f"{where}: station '{shown(name)}' has {n} reading{'s' if n > 1 else ''} and no [[station]]{hint} "
        "mend the name, or give it a [[station]] if it is one of its own"
    )
