"""A section of the page, and how figures become part of it."""

from __future__ import annotations

import re
from collections import Counter
from dataclasses import dataclass
from io import StringIO
from itertools import count
from typing import TYPE_CHECKING, Any

from markupsafe import Markup

from volid.exceptions import shown

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_NUMBER = count(1)
_UNSEEN = re.compile(
    "[\x00-\x08\x0b-\x1f\x7f-\x9f\u200b-\u200f\u2028-\u202e\u2060-\u206f\ufeff]"
)  # controls, marks of direction


@dataclass(frozen=True)
class Section:
    """A section of the page.

    Args:
        id: Its anchor, such as "functions".
        title: Its heading, in the language of the page.
        body: HTML that is safe: made by `Markup` or by a template, which escape what comes from files.
        data: What the script of the page needs, ready for JSON, under the section's `id`.
    """

    id: str
    title: str
    body: Markup
    data: Any = None


def svg(figure: Figure, label: str) -> Markup:
    """A figure as SVG within the page, with its own names, so that figures do not take each other's clip paths.

    Args:
        figure: A figure of matplotlib.
        label: What it shows, read aloud where it cannot be seen.
    """
    from matplotlib import rc_context

    stream = StringIO()
    with rc_context({"svg.fonttype": "none", "svg.hashsalt": "volid"}):
        figure.savefig(stream, format="svg", metadata={"Date": None, "Creator": None, "Format": None, "Type": None})
    text, number = _UNSEEN.sub(lambda match: shown(match.group()), stream.getvalue()), next(_NUMBER)
    text = text[text.index("<svg") :]
    seen: Counter[str] = Counter()
    text = re.sub(r'\bid="([^"]+)"', lambda found: f'id="f{number}-{_once(found[1], seen)}"', text)
    text = re.sub(r'(xlink:href="#|url\(#)', rf"\1f{number}-", text)
    text = re.sub(r"<metadata>.*?</metadata>", "", text, flags=re.S)
    opening = Markup('<svg role="img" aria-label="{}"').format(label)
    return Markup(text.replace("<svg", opening, 1))  # matplotlib escapes the texts of a figure


def _once(name: str, seen: Counter[str]) -> str:
    """The name of an element; a number after it where the figure has it already: a name must be the only one of its page.

    >>> seen = Counter()
    >>> _once("rms", seen), _once("rms", seen)
    ('rms', 'rms-2')
    """
    seen[name] += 1
    return name if seen[name] == 1 else f"{name}-{seen[name]}"
