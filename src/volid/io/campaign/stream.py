"""Campaigns that are larger than memory: read from their HDF5 file part by part."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from volid.campaign import ROW_ARRAYS, Campaign, End, ObservationSet
from volid.effects.environment.matching import narrowed
from volid.exceptions import InputError
from volid.io.basics.hdf5_values import is_hdf5, reading
from volid.io.campaign.hdf5 import read_outline, read_set
from volid.io.campaign.rules import FORMAT, check_consistent

PART = 2**17  # rows read at once
EACH = 25  # rows that a sample has at least of every combination of labels: station and segment, sphere, …


class CampaignStream:
    """A campaign in an HDF5 file that is read part by part, so that it need not fit into memory.

    Args:
        path: Path of a file that `volid.save_campaign` or `volid import` has written.

    Attributes: `rows`, the number of rows in all sets, and `n_readings`, that of scalar readings.

    Raises:
        InputError: the file is missing, no HDF5 file, of another type, or incomplete.

    >>> import volid
    >>> from pathlib import Path
    >>> from tempfile import mkdtemp
    >>> path = Path(mkdtemp()) / "campaign.h5"
    >>> volid.save_campaign(volid.load_campaign("datasets/vertical_multilateration/campaign.toml"), path)
    >>> stream = volid.CampaignStream(path)
    >>> stream.rows, [part.n_readings for part in stream.parts(rows=1000)]
    (2400, [1000, 1000, 400])
    """

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        if not is_hdf5(path):
            raise InputError(
                f"{path}: not an HDF5 file; only those can be read part by part. Convert the campaign with `volid.save_campaign`"
            )
        with reading(path, "campaign", FORMAT) as file:
            groups = file.group("sets").numbered()
            self.rows = sum(g.length("positions", 2) for g in groups)
            self.n_readings = sum(g.dataset("readings", (None, None)).size for g in groups)

    def parts(self, rows: int = PART) -> Iterator[Campaign]:
        """The campaign in parts: campaigns of one set with at most `rows` rows each, in the order of the file.

        Raises:
            InputError: a row lacks a finite reading, position, tool vector or u; the text names file and row.
        """
        with reading(self.path, "campaign", FORMAT) as file:
            outline = read_outline(file)
            for group in file.group("sets").numbered():
                for start in range(0, group.length("positions", 2), rows):
                    readings = read_set(group, outline.machine, slice(start, start + rows))
                    yield check_consistent(narrowed(replace(outline, sets=(_finite(readings),))))

    def sample(self, rows: int) -> Campaign:
        """A campaign of about `rows` rows spread evenly over the file, with at least 25 rows of every combination of labels.

        Raises:
            InputError: no set has a row.
        """
        step = max(1, -(-self.rows // rows))
        found: dict[str, list[ObservationSet]] = {}
        seen: dict[tuple[str, ...], int] = {}
        with reading(self.path, "campaign", FORMAT) as file:
            outline = read_outline(file)
        for part in self.parts():
            (readings,) = part.sets
            wanted = np.zeros(len(readings), dtype=bool)
            wanted[::step] = True
            _want_all_labels(readings, wanted, seen)
            found.setdefault(readings.name, []).append(readings.rows_of(np.flatnonzero(wanted)))
        if not found:
            raise InputError(f"{self.path}: no set has a row; expected readings")
        return replace(outline, sets=tuple(_joined(parts) for parts in found.values()))


def _finite(readings: ObservationSet) -> ObservationSet:
    seen = readings.side_by_side
    numbers = {"positions": seen.positions, "tool": seen.tool, "readings": readings.readings, "u": readings.u}
    for name, values in numbers.items():
        wrong = ~np.isfinite(values).all(axis=1)
        if wrong.any():
            where = readings.where(int(np.argmax(wrong)))
            raise InputError(
                f"{where}: {name} holds no number; expected measured readings with position, tool vector and u"
            )
    return readings


def _want_all_labels(readings: ObservationSet, wanted: np.ndarray, seen: dict[tuple[str, ...], int]) -> None:
    """Mark rows until each combination of labels has `EACH`."""
    if not readings.labels:
        return
    columns = [np.unique(v, return_inverse=True) for v in readings.labels.values()]
    codes = np.stack([np.asarray(code).ravel() for _, code in columns], axis=1)
    combinations, index = np.unique(codes, axis=0, return_inverse=True)
    index = np.asarray(index).ravel()
    for i, combination in enumerate(combinations):
        key = (readings.name, *(str(names[c]) for (names, _), c in zip(columns, combination, strict=True)))
        rows = np.flatnonzero(index == i)
        missing, unmarked = EACH - seen.get(key, 0) - int(wanted[rows].sum()), rows[~wanted[rows]]
        if missing > 0 and unmarked.size:
            wanted[unmarked[np.linspace(0, len(unmarked) - 1, min(missing, len(unmarked))).astype(int)]] = True
        seen[key] = seen.get(key, 0) + int(wanted[rows].sum())


def _joined(parts: list[ObservationSet]) -> ObservationSet:
    first = parts[0]
    joined: dict[str, Any] = {
        name: np.concatenate([getattr(p, name) for p in parts])
        for name in ROW_ARRAYS
        if all(getattr(p, name) is not None for p in parts)
    }
    labels = {name: np.concatenate([p.labels[name] for p in parts]) for name in first.labels}
    if first.to is not None:
        joined["to"] = End(*(np.concatenate(values) for values in zip(*(p.ends[1] for p in parts), strict=True)))
    return replace(first, labels=labels, **joined)
