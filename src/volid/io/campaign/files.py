"""Any campaign from any file: text or HDF5 by content, several merged into one."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

from volid.campaign import Campaign
from volid.exceptions import InputError, shown
from volid.io.basics.hdf5_values import is_hdf5
from volid.io.campaign.environments import joined
from volid.io.campaign.hdf5 import read_campaign
from volid.io.campaign.manifest import MANIFEST, read_manifest
from volid.io.campaign.rules import check_consistent, check_unique
from volid.io.instruments.recognition import known_as
from volid.model.machine import Machine

_HDF5 = (".h5", ".hdf5")
_ENDINGS = (*_HDF5, ".toml")


def load_campaign(*paths: str | Path, plan: bool = False, allow_outside: bool = False) -> Campaign:
    """A campaign from files, as `datasets/README.md` describes them; several are merged.

    Args:
        paths: HDF5 files and text manifests (TOML) in any mixture. All have the same machine; stations of one name are
            defined alike, and sets have different names.
        plan: manifests may lack readings, which are NaN then.
        allow_outside: manifests may name files outside their own folder; for manifests that are trusted.

    Raises:
        InputError: naming file and row or key, for anything that is missing, unknown, contradictory or of the wrong type.

    >>> import volid
    >>> campaign = volid.load_campaign("datasets/five_axis_rtest/campaign.toml")
    >>> campaign.n_readings, campaign.sets[0].kind
    (4329, 'displacement')
    """
    if not paths:
        raise InputError("no campaign was given; name a manifest (TOML) or a campaign file (HDF5)")
    places = [os.path.realpath(path) for path in paths]
    for i, place in enumerate(places):
        if place in places[:i]:
            raise InputError(f"{paths[i]} is given twice; name every campaign once")
    campaigns = [_load(Path(path), plan, allow_outside) for path in paths]
    return campaigns[0] if len(campaigns) == 1 else _merge(campaigns)


def is_campaign(path: str | Path) -> bool:
    """Whether a file is a campaign or meant to be one: HDF5 by content, else by the ending of its name; a folder is too."""
    path = Path(path)
    return is_hdf5(path) or path.suffix.lower() in _ENDINGS or path.is_dir()


def _load(path: Path, plan: bool, allow_outside: bool) -> Campaign:
    if path.is_dir():
        raise InputError(f"{path} is a folder; name the manifest in it, such as {path / MANIFEST}")
    if is_hdf5(path):
        return _storable(read_campaign(path))
    if path.suffix.lower() in _HDF5:
        raise InputError(f"{path}: not an HDF5 file, though its name says so; copy or write it again")
    if path.suffix.lower() == ".csv":
        raise InputError(f"{path} is a table of readings; give the manifest (TOML) that names it, such as {MANIFEST}")
    if path.suffix.lower() != ".toml" and (known := known_as(path)):
        raise InputError(
            f'{path}: this is {known.words}, and no campaign; name it in a [[set]] of a manifest, with as = "{known.name}"'
        )
    return _storable(read_manifest(path, plan=plan, allow_outside=allow_outside))


def _storable(campaign: Campaign) -> Campaign:
    """The campaign with its files named as messages show them: a name of bytes that are no text could not be stored."""
    sets = tuple(replace(s, source=shown(s.source)) for s in campaign.sets)
    return replace(campaign, source=shown(campaign.source), sets=sets)


_NAMING = ", in its manifest or by the key name when it is imported"  # a file gives its own name to a set


def _merge(campaigns: list[Campaign]) -> Campaign:
    first = campaigns[0]
    for other in campaigns[1:]:
        if not _same_machine(first.machine, other.machine):
            raise InputError(
                f"{other.source}: machine '{other.machine.name}' is not the machine '{first.machine.name}' of "
                f"{first.source}; only campaigns with the same machine file can be fitted together"
            )
    where = ", ".join(c.source for c in campaigns)
    check_unique((s.name for c in campaigns for s in c.sets), "set", where, _NAMING)
    return check_consistent(
        Campaign(
            machine=first.machine,
            stations=_merged(campaigns, lambda c: c.stations, "station"),
            alignments=_merged(campaigns, lambda c: c.alignments, "alignment"),
            sets=tuple(s for c in campaigns for s in c.sets),
            environments=joined([c.environments for c in campaigns]),
            title="; ".join(dict.fromkeys(c.title for c in campaigns if c.title)),
            conditions=_merge_conditions(campaigns),
            warnings=(*dict.fromkeys(w for c in campaigns for w in c.warnings), *_states(campaigns)),
            source=where,
            active_files=tuple({f.text: f for c in campaigns for f in c.active_files}.values()),
        )
    )


def _same_machine(a: Machine, b: Machine) -> bool:
    """Same text but for white space, or equal machines."""
    return (bool(a.text) and a.text.split() == b.text.split()) or bool(a == b)


def _merged(campaigns: list[Campaign], given: Callable[[Campaign], tuple[Any, ...]], what: str) -> tuple[Any, ...]:
    """Stations or alignments of all campaigns; raises `InputError` when two of one name differ."""
    found: dict[str, tuple[Any, str]] = {}
    for campaign in campaigns:
        for entry in given(campaign):
            known, source = found.setdefault(entry.name, (entry, campaign.source))
            if known != entry:
                raise InputError(
                    f"{campaign.source}: {what} '{entry.name}' is defined otherwise in {source}; "
                    f"use another name for another {what}, or the same definition"
                )
    return tuple(entry for entry, _ in found.values())


def _states(campaigns: list[Campaign]) -> list[str]:
    """A warning where files of a control were active for some of the campaigns, and not, or others, for the rest."""
    named = {c.source: ", ".join(a.text for a in c.active_files) or "none" for c in campaigns}
    if len(set(named.values())) == 1:
        return []
    each = "; ".join(f"{source}: {text}" for source, text in named.items())
    return [
        f"different files of a control were active while measuring ({each}): the machine had different errors, and one model of "
        "both is right only for axes that the files do not move. Fit them one by one"
    ]


def _merge_conditions(campaigns: list[Campaign]) -> dict[str, Any]:
    """The common conditions, or, where they differ, each file's own under the file's name."""
    given = [c for c in campaigns if c.conditions]
    if all(c.conditions == given[0].conditions for c in given):
        return dict(given[0].conditions) if given else {}
    return {c.source: dict(c.conditions) for c in given}
