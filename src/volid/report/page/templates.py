"""Templates of the page: Jinja2 files in `assets/`; what they are given is escaped, names are isolated from the text around."""

from __future__ import annotations

import re
from functools import cache
from importlib.resources import files
from typing import Any

from markupsafe import Markup

from volid.exceptions import shown
from volid.report.language import Texts
from volid.report.page.numbers import Numbers

_WORD = re.compile(r"[A-Za-z]+[,:]?( |$)")  # a plain word, no name of a file or setting


@cache
def environment() -> Any:
    """The environment of Jinja2, with the filters `said`, `english` and `sentence`."""
    from jinja2 import Environment, FunctionLoader, StrictUndefined

    found = Environment(
        loader=FunctionLoader(asset), autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    found.filters |= {"said": said, "english": english, "sentence": sentence}
    return found


def asset(name: str) -> str:
    """The text of a file of `assets/`."""
    return (files("volid.report.page") / "assets" / name).read_text(encoding="utf-8")


def render(name: str, texts: Texts, **values: Any) -> Markup:
    """A template of `assets/` with `values`, the `texts` of a language, and `numbers` in that language."""
    return Markup(environment().get_template(name).render(texts=texts, numbers=Numbers(texts), **values))


def said(text: object) -> Markup:
    """What a user wrote, such as the name of a station: control characters and marks of direction are shown, not obeyed.

    >>> print(said('<b>S1\\u202e'))
    <bdi>&lt;b&gt;S1\\u202e</bdi>
    """
    return Markup("<bdi>{}</bdi>").format(shown(str(text)))


def english(text: object) -> Markup:
    """A sentence that the library composes, which stays English on a German page.

    >>> print(english("model accepted by the data"))
    <span lang="en">model accepted by the data</span>
    """
    return Markup('<span lang="en">{}</span>').format(shown(str(text)))


def sentence(text: str) -> Markup:
    """The same as a whole sentence; what begins with a name, such as that of a file, keeps it as it is.

    >>> print(sentence("the fit has not converged"), sentence("data/runs.csv: read in µm"))
    <span lang="en">The fit has not converged.</span> <span lang="en">data/runs.csv: read in µm.</span>
    """
    text = text[:1].upper() + text[1:] if _WORD.match(text) else text
    return english(text if text.endswith((".", "?", "!")) else f"{text}.")
