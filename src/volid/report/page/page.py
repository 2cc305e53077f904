"""The page: sections in their order, within the template."""

from __future__ import annotations

import json
from functools import cache
from importlib import import_module
from importlib.resources import files
from typing import Any

from markupsafe import Markup

from volid.report.contents.contents import Contents
from volid.report.language import Texts
from volid.report.page.section import Section
from volid.report.page.sections import ORDER


@cache
def environment() -> Any:
    """Templates of the page; what they are given is escaped."""
    from jinja2 import Environment, FunctionLoader, StrictUndefined

    return Environment(loader=FunctionLoader(asset), autoescape=True, undefined=StrictUndefined, trim_blocks=True)


def asset(name: str) -> str:
    """The text of a file of `assets/`."""
    return (files("volid.report.page") / "assets" / name).read_text(encoding="utf-8")


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
            style=Markup(asset("page.css")),
            script=Markup(asset("page.js")),
            data=_as_script({s.id: s.data for s in sections if s.data is not None}),
        )
    )


def _section(name: str, contents: Contents, texts: Texts) -> Section | None:
    return import_module(f"volid.report.page.sections.{name}").build(contents, texts)


def _as_script(data: Any) -> Markup:
    """JSON within a script element, whatever its texts contain."""
    return Markup(json.dumps(data, ensure_ascii=False, allow_nan=False, separators=(",", ":")).replace("<", "\\u003c"))
