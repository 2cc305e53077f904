"""Whether the files that new values are added to are those that were active while measuring, all of them and each once.

The record of a campaign holds the files themselves. New values are what remained with all of them: a sum is right only with the
same contents, and files that a control replaces without their being in the sum bring their errors back (ISO/TR 16907 10.4, 10.5).
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from functools import reduce
from pathlib import PurePosixPath

from volid.campaign import ActiveFiles, Campaign
from volid.compensation.on_top import add_compensations
from volid.compensation.package import Compensation
from volid.controllers.existing.reading import ExistingCompensation, Files, read_existing
from volid.controllers.existing.state import REPLACED, meet
from volid.exceptions import InputError

OTHER = "by the record it held something else"


def refuse_same_files(existing: Sequence[ExistingCompensation]) -> None:
    """Raises `InputError` for a file that would be added twice."""
    seen: set[tuple[str, bytes]] = set()
    for e in existing:
        again = [name for name, content in _by_name(e.files) if (name, content) in seen]
        if again:
            raise InputError(
                f"`add_to`: {', '.join(again)} would be added twice, because it is named and is among the files that the "
                "campaign holds as well, or is named twice; name it once"
            )
        seen |= set(_by_name(e.files))


def not_in_sum(
    campaign: Campaign, existing: Sequence[ExistingCompensation], types: Iterable[str] | None = None, cnc: str = ""
) -> list[str]:
    """Sentences for what was active while measuring and is not in the sum, though files of the sum replace it.

    Args:
        campaign: The campaign, with the files that were active.
        existing: Those that new values are added to; without any there is no sum, and no sentence.
        types: Types of the new files, which replace what corrects the same; None: all is named.
        cnc: The control of the new files.
    """
    wanted = None if types is None else list(types)
    found = []
    for a in campaign.active_files if existing else ():
        lacking, other = _lacking(a, existing)
        concerned = wanted is None or any(meet(n, t) if a.cnc == cnc else n == t for n in wanted for t in a.types)
        if other:
            found.append(
                f"{', '.join(other)}: {OTHER} while the campaign was measured ({a.text}); new values are what remained with "
                "that, and the sum is right with that alone"
            )
        if lacking and concerned:
            found.append(
                f"{', '.join(lacking)} of {a.text} was active while the campaign was measured, and is not in the sum; the files "
                f"{REPLACED} it where they are loaded in its place, and its errors come back; add it as well"
            )
    return found


def stood_for(campaign: Campaign, cnc: str, existing: Sequence[ExistingCompensation]) -> Compensation | None:
    """What files of the control `cnc` stand in the place of: what they are a sum with, and what was active in it while measuring.

    Errors of a solution are relative to that. None where there is nothing.
    """
    recorded = [a for a in campaign.active_files if a.cnc == cnc]
    types = [t for a in recorded for t in a.types]
    added = [e for e in existing if not _known(e, recorded, types)]
    parts = [e.compensation for e in added]
    for a in recorded:
        parts.append(
            read_existing(a.files, campaign.machine, a.cnc, sign=a.sign or None, options=a.options).compensation
        )
    return reduce(add_compensations, parts) if parts else None


def _known(e: ExistingCompensation, recorded: Sequence[ActiveFiles], types: Sequence[str]) -> bool:
    """Whether the record says what was active in the place of an existing compensation."""
    return bool(recorded) and any(meet(a, b) for a in e.types for b in types)


def _lacking(a: ActiveFiles, existing: Sequence[ExistingCompensation]) -> tuple[list[str], list[str]]:
    """Names of recorded files that are not among the existing ones, and of those that are there with another content."""
    same = [e for e in existing if e.cnc == a.cnc]
    known = {pair for e in same for pair in _by_name(e.files)}
    names = {name for name, _ in known}
    missing = [name for name, content in _by_name(a.files) if (name, content) not in known]
    return [n for n in missing if n not in names], [n for n in missing if n in names]


def _by_name(files: Files) -> Iterator[tuple[str, bytes]]:
    for name, content in files.items():
        yield PurePosixPath(name).name, content
