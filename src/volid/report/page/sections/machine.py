"""Section "machine" of the page."""

from __future__ import annotations

from volid.report.contents.contents import Contents
from volid.report.language import Texts
from volid.report.page.section import Section


def build(contents: Contents, texts: Texts) -> Section | None:
    """The section, None where there is nothing to show."""
    return None
