"""Section "not_determined" of the page: what the readings do not tell, and which reading would settle it."""

from __future__ import annotations

from collections.abc import Sequence

from volid.model.iso230 import LINEAR_AXES, parse
from volid.report.contents.contents import Contents
from volid.report.language import Texts
from volid.report.page.section import Section
from volid.report.page.templates import render


def build(contents: Contents, texts: Texts) -> Section | None:
    """The statements of the fit with their advice; one sentence where everything is determined."""
    solution = contents.solution
    body = render(
        "not_determined.html",
        texts,
        summary=contents.summary,
        unseen=[] if contents.summary["rejected"] and contents.summary["causes"] else contents.summary["unseen"],
        functions=[name for name, count in solution.undetermined.items() if count > 0],
        readings=readings_for(contents.summary["volume"]["left_out"]),
    )
    return Section("not_determined", texts("page.section_not_determined"), body)


def readings_for(names: Sequence[str]) -> dict[str, list[str]]:
    """What has to be measured for error motions: their names by the key of the text that says so.

    >>> readings_for(["EXX", "EYX", "EAX", "ECC"])
    {'positioning': ['EXX'], 'straightness': ['EYX'], 'angular': ['EAX'], 'rotary': ['ECC']}
    """
    found: dict[str, list[str]] = {}
    for name in names:
        found.setdefault(_kind_of(name), []).append(name)
    return found


def _kind_of(name: str) -> str:
    error = parse(name)
    if error.axis not in LINEAR_AXES:
        return "rotary"
    if error.is_rotation:
        return "angular"
    return "positioning" if name[1] == error.axis else "straightness"
