"""Docstrings for autodoc: they are written as plain text with names in single backquotes, and reStructuredText is stricter.

Outside examples, a name in backquotes becomes a literal, and signs that would be markup elsewhere (|B|, reference_, 2*n) are
shown as they are.
"""

import re

_NAME = re.compile(r"``.*?``|`[^`]+`", re.S)


def process(app, what, name, obj, options, lines: list[str]) -> None:
    """Called by autodoc for every docstring; changes `lines`."""
    paragraphs = re.split(r"(\n\s*\n)", "\n".join(lines))
    lines[:] = "".join(p if example(p) else prose(p) for p in paragraphs).split("\n")


def example(paragraph: str) -> bool:
    """True for a session at the prompt and for what is set in columns."""
    words = paragraph.lstrip()
    return words.startswith((">>>", ".. ")) or (paragraph.startswith("    ") and not words.startswith("-"))


def prose(paragraph: str) -> str:
    """A paragraph with names as literals, and other signs protected."""
    end, parts = 0, []
    for match in _NAME.finditer(paragraph):
        before, after = paragraph[max(0, match.start() - 1) : match.start()], paragraph[match.end() : match.end() + 1]
        parts += [protected(paragraph[end : match.start()]), literal(match.group(), before, after)]
        end = match.end()
    return "".join([*parts, protected(paragraph[end:])])


def literal(text: str, before: str, after: str) -> str:
    """In double backquotes, kept apart from signs that reStructuredText does not expect beside them."""
    inside = text.strip("`")
    left = "" if not before or before in " \n'\"([{<-/:" else "\\ "
    right = "" if not after or after in " \n'\")]}>-/\\:.,;!?" else "\\ "
    return f"{left}``{inside}``{right}"


def protected(text: str) -> str:
    """Bars, and underscores that end a word, are no markup here."""
    return re.sub(r"(?<=\w)_(?=\W|$)", r"\\_", re.sub(r"(?<!\\)\|", r"\\|", text))
