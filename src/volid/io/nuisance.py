"""Nuisance parameters in a solution's file, with key and response in plain text; files of earlier versions have only names."""

from __future__ import annotations

import json
from collections.abc import Sequence

import h5py
import numpy as np

from volid.campaign import Campaign
from volid.effects.prediction import groups_of
from volid.io.basics.hdf5_values import read_text, to_json, write_array, write_text
from volid.observations.base import Nuisance, NuisanceTable
from volid.observations.response import Remainder, Unmoved, as_rows, from_plain, to_plain

_TEXTS = ("name", "unit", "distribution", "effect")
_NUMBERS = ("start", "prior_u", "spread")
_NOT_KNOWN = (
    "the file was written by an earlier version, and this one makes other unknowns of its campaign, so that it cannot tell how "
    "'{name}' answers. Fit the campaign again"
)


def write_nuisance(group: h5py.Group, table: Sequence[Nuisance]) -> None:
    """One dataset per field; `key` and `response` as JSON texts."""
    for name in _TEXTS:
        write_text(group, name, [getattr(entry, name) for entry in table])
    for name in _NUMBERS:
        write_array(group, name, [getattr(entry, name) for entry in table])
    write_array(group, "recorded", [entry.recorded for entry in table], bool)
    write_text(group, "key", [to_json(list(entry.key)) for entry in table])
    write_text(group, "response", [to_json(to_plain(entry.response)) for entry in table])


def read_nuisance(group: h5py.Group, campaign: Campaign) -> tuple[Nuisance, ...]:
    """The table of a solution; key and response of an older file are made again from its campaign."""
    columns = {name: read_text(group[name]).tolist() for name in _TEXTS}
    columns |= {name: group[name][()].tolist() for name in _NUMBERS}
    entries = [Nuisance(**dict(zip(columns, row, strict=True))) for row in zip(*columns.values(), strict=True)]
    if "key" not in group:
        return _remade(entries, campaign)
    keys = [tuple(json.loads(text)) for text in read_text(group["key"]).tolist()]
    responses = [from_plain(json.loads(text)) for text in read_text(group["response"]).tolist()]
    recorded = group["recorded"][()].tolist()
    more = zip(keys, responses, recorded, strict=True)
    return tuple(
        Nuisance(**{**vars(e), "key": k, "response": r, "recorded": bool(b)})
        for e, (k, r, b) in zip(entries, more, strict=True)
    )


def _remade(entries: list[Nuisance], campaign: Campaign) -> tuple[Nuisance, ...]:
    table = NuisanceTable()
    for readings in campaign.sets:
        groups_of(readings, campaign, table)
    if [e.name for e in table.entries] != [e.name for e in entries]:
        never = as_rows(1e12 * np.eye(9))
        return tuple(
            Nuisance(
                **{
                    **vars(e),
                    "key": (e.name,),
                    "response": Unmoved(left=Remainder(never, _NOT_KNOWN.format(name=e.name))),
                }
            )
            for e in entries
        )
    return tuple(
        Nuisance(**{**vars(e), "key": made.key, "response": made.response, "recorded": made.recorded})
        for e, made in zip(entries, table.entries, strict=True)
    )
