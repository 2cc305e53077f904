"""The numbers of an HTML page, read back as any program would: every `<data>` element with its section, and the text around."""

from __future__ import annotations

from html.parser import HTMLParser
from typing import NamedTuple

FACTOR = {"mm": 1e3, "rad": 1e6}  # library's unit: of the page


class Number(NamedTuple):
    """One `<data>` element: section it stands in, key, exact value, the library's unit, the text that people read."""

    section: str
    key: str
    value: float
    unit: str
    text: str


class Page(HTMLParser):
    """A page taken apart: `numbers`; `texts` in own words as (section, text), English sentences and users' words left out;
    `links`, `tags`, `ids`."""

    def __init__(self, html: str) -> None:
        super().__init__(convert_charrefs=True)
        self.numbers: list[Number] = []
        self.texts: list[tuple[str, str]] = []
        self.links: list[str] = []
        self.tags: list[str] = []
        self.ids: list[str] = []
        self._stack: list[tuple[str, dict[str, str]]] = []
        self._section, self._data = "", None
        self.feed(html)
        self.close()

    def handle_starttag(self, tag, attrs):
        given = {k: v or "" for k, v in attrs}
        self.tags.append(tag)
        self.ids += [given["id"]] if "id" in given else []
        self.links += [given[k] for k in ("href", "src", "xlink:href") if k in given]
        if tag == "section" and "id" in given:
            self._section = given["id"]
        if tag == "data":
            self._data = (given, [])
        if tag not in ("meta", "link", "br", "img", "input", "path", "use", "rect", "circle", "line", "polyline"):
            self._stack.append((tag, given))

    def handle_endtag(self, tag):
        if tag in (t for t, _ in self._stack):
            while self._stack.pop()[0] != tag:
                pass
        if tag == "data" and self._data is not None:
            given, parts = self._data
            text = "".join(parts)
            self.numbers.append(
                Number(
                    self._section, given.get("data-key", ""), float(given["value"]), given.get("data-unit", ""), text
                )
            )
            self._data = None

    def handle_data(self, data):
        if self._data is not None:
            self._data[1].append(data)
        elif data.strip() and not self._foreign():
            self.texts.append((self._section, data.strip()))

    def _foreign(self) -> bool:
        """Whether what follows is not in the page's own words: code, names of users, sentences of the library."""
        return any(t in ("bdi", "code", "style", "script", "svg") or a.get("lang") == "en" for t, a in self._stack[1:])


def plain(text: str) -> str:
    """A number of the page as Python reads it."""
    return text.replace("−", "-").replace("\u202f", "").replace(",", ".")


def places(text: str) -> int:
    """Decimal places of a number of the page."""
    return len(plain(text).partition(".")[2].partition("e")[0])
