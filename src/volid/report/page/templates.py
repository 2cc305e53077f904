"""Templates and other files of `assets/`, and how they are filled."""

from __future__ import annotations

from functools import cache
from importlib.resources import files
from typing import Any

from markupsafe import Markup

from volid.report.language import Texts


@cache
def environment() -> Any:
    """Templates of the page; what they are given is escaped."""
    from jinja2 import Environment, FunctionLoader, StrictUndefined

    return Environment(loader=FunctionLoader(asset), autoescape=True, undefined=StrictUndefined, trim_blocks=True)


def asset(name: str) -> str:
    """The text of a file of `assets/`."""
    return (files("volid.report.page") / "assets" / name).read_text(encoding="utf-8")


def filled(name: str, texts: Texts, **values: Any) -> Markup:
    """A template of `assets/` with its values, which are escaped unless they are `Markup`."""
    return Markup(environment().get_template(name).render(texts=texts, **values))
