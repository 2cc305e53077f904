"""The page: sections in their order, within the template."""

from __future__ import annotations

import json
from importlib import import_module
from typing import Any

from markupsafe import Markup

from volid.report.contents.contents import Contents
from volid.report.language import Texts
from volid.report.page.packing import library
from volid.report.page.section import Section
from volid.report.page.sections import ORDER
from volid.report.page.templates import asset, environment

SCRIPTS = ("scene.js", "field.js", "stations.js", "page.js")
STYLES = ("page.css", "scene.css")
DRAWN = ("field", "stations")  # sections whose data are drawn in 3-D


def page(contents: Contents, texts: Texts) -> str:
    """The report as HTML: one text that needs no other file.

    Args:
        contents: As `gather` gives them.
        texts: The language of the page.
    """
    sections = [s for name in ORDER if (s := _section(name, contents, texts)) is not None]
    return (
        environment()
        .get_template("page.html")
        .render(
            texts=texts,
            contents=contents,
            title=texts("page.title", machine=contents.solution.machine.name),
            sections=sections,
            style=Markup("\n".join(asset(name) for name in STYLES)),
            script=Markup("\n".join(asset(name) for name in SCRIPTS)),
            library=Markup(library() if any(s.id in DRAWN and s.data is not None for s in sections) else ""),
            data=_as_script({s.id: s.data for s in sections if s.data is not None}),
        )
    )


def _section(name: str, contents: Contents, texts: Texts) -> Section | None:
    return import_module(f"volid.report.page.sections.{name}").build(contents, texts)


def _as_script(data: Any) -> Markup:
    """JSON within a script element, whatever its texts contain."""
    return Markup(json.dumps(data, ensure_ascii=False, allow_nan=False, separators=(",", ":")).replace("<", "\\u003c"))
