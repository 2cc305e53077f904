"""Nuisance parameters in the file of a solution, with key and response as plain text; older files have only their names."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import h5py
import numpy as np

from volid.campaign import Campaign
from volid.effects.prediction import groups_of
from volid.exceptions import InputError
from volid.io.basics.hdf5_group import Group, parse_json
from volid.io.basics.hdf5_structure import shown
from volid.io.basics.hdf5_values import to_json, write_array, write_text
from volid.observations.base import Nuisance, NuisanceTable
from volid.observations.response import Remainder, Response, Unmoved, as_rows, from_plain, to_plain

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


def read_nuisance(group: Group, campaign: Campaign) -> tuple[Nuisance, ...]:
    """The table of a solution; key and response of an older file are made again from its campaign."""
    k = group.length("name")
    columns: dict[str, list[Any]] = {name: group.texts(name, (k,)).tolist() for name in _TEXTS}
    columns |= {name: group.array(name, (k,)).tolist() for name in _NUMBERS}
    entries = [Nuisance(**dict(zip(columns, row, strict=True))) for row in zip(*columns.values(), strict=True)]
    if "key" not in group:
        return _remade(entries, campaign)
    keys = [as_key(parse_json(text, list, group.place("key")), group) for text in group.texts("key", (k,)).tolist()]
    responses = [_response(text, group) for text in group.texts("response", (k,)).tolist()]
    recorded = group.array("recorded", (k,), bool).tolist()
    more = zip(keys, responses, recorded, strict=True)
    return tuple(
        Nuisance(**{**vars(e), "key": k, "response": r, "recorded": bool(b)})
        for e, (k, r, b) in zip(entries, more, strict=True)
    )


def as_key(found: list[Any], group: Group) -> tuple[Any, ...]:
    """The key of a parameter: texts and numbers."""
    if not all(isinstance(part, str | int | float) for part in found):
        raise InputError(f"{group.place('key')}: holds {shown(str(found))}; expected lists of texts and numbers")
    return tuple(found)


def _response(text: str, group: Group) -> Response:
    where = group.place("response")
    plain = parse_json(text, dict, where)
    try:
        response = from_plain(plain)
        response.row(lambda key: 0.0)
        return response
    except (TypeError, ValueError, LookupError, AttributeError):
        raise InputError(
            f"{where}: holds {shown(text)}; expected how an unknown answers a motion of its frame"
        ) from None


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
                    "response": Unmoved(not_followed=Remainder(never, _NOT_KNOWN.format(name=e.name))),
                }
            )
            for e in entries
        )
    return tuple(
        Nuisance(**{**vars(e), "key": made.key, "response": made.response, "recorded": made.recorded})
        for e, made in zip(entries, table.entries, strict=True)
    )
