"""What is wrong with a line that is no TOML, in the words of who wrote it: the parser says what it stumbled over, not why."""

from __future__ import annotations

import re
import unicodedata

_PLACE = re.compile(r"^(.*) \(at line (\d+), column (\d+)\)$", re.DOTALL)
_TWICE = (
    "Cannot overwrite a value",
    "Cannot declare",
    "Cannot mutate immutable namespace",
    "Duplicate inline table key",
)


def explained(error: str, text: str) -> str:
    """Line, what the parser found, and what to do: "line 3: not valid TOML: Invalid value, column 8; put texts in quotes"."""
    place = _PLACE.search(error)
    lines = text.split("\n")
    number = int(place[2]) if place else len(lines)
    line = lines[min(number, len(lines)) - 1]
    what = f"{place[1]}, column {place[3]}" if place else error
    return f"line {number}: not valid TOML: {what}; {_cure(what, line)}"


def _cure(what: str, line: str) -> str:
    """What to do about it, where the line shows what was meant."""
    bare = line.split("#")[0].strip()
    foreign = next(
        (c for c in bare if not c.isascii() and unicodedata.category(c) in ("Zs", "Pi", "Pf", "Ps", "Cf")), None
    )
    if what.startswith(_TWICE):
        name = bare.strip("[] ") if bare.startswith("[") else bare.split("=")[0].strip()
        several = f"; where there may be several, head each with [[{name}]]" if bare.startswith("[") else ""
        return f"'{name}' stands twice{several or ', keep one'}"
    if "Unescaped" in what and "\\" in line:
        return "a path in quotes has / between its folders, or two \\"
    if foreign is not None and not what.startswith("Unterminated"):
        name = unicodedata.name(foreign, "a character").lower()
        return f"'{foreign}' (U+{ord(foreign):04X}, {name}) is no TOML; type a plain quote or blank instead"
    if re.search(r"[=,{\[]\s*[-+]?\d+,\d", bare) and "quote" not in what:
        return "mend the line; numbers have decimal points"
    if what.startswith("Invalid value") and "=" in bare:
        return "put a text in quotes, write true or false in small letters, and numbers with decimal points"
    return "mend the line"
