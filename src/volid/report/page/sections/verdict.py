"""Section "verdict" of the page."""

from __future__ import annotations

from markupsafe import Markup

from volid.report.contents.contents import Contents
from volid.report.language import Texts
from volid.report.page.section import Section


def build(contents: Contents, texts: Texts) -> Section | None:
    """The section, None where there is nothing to show."""
    body = Markup("<p>{}</p>").format(contents.summary["verdict"])
    return Section("verdict", texts("page.section_verdict"), body)
