"""Section "not_determined" of the page: what the readings do not tell, and which reading would settle it."""

from __future__ import annotations

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
    )
    return Section("not_determined", texts("page.section_not_determined"), body)
