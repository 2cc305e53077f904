"""`.b5r`: a ball-bar test as its program has evaluated it: squareness, scale mismatch, straightness, backlash, in one plane.

The element that holds the trace of the radius is not publicly known. What is read is the vendor's evaluation, and no readings are
made of it: for a fit, export the trace as a table and name it in a set of kind `distance`.

An XML document with a document type declaration is refused, because its entities can be made to fill the memory.
"""

from __future__ import annotations

import re
from typing import Any
from xml.parsers import expat

from volid.io.instruments.base import FROM_DESCRIPTIONS, EvaluatedFormat, Evaluation, ForeignFile, Format
from volid.io.instruments.numerals import decimal_of, number

COLUMNS = ("feature", "plane", "value", "unit", "type")
_UNITS = {
    "UT_LENGTH_UM": "µm",
    "UT_LENGTH_MM": "mm",
    "UT_LENGTH_M": "m",
    "UT_SQUARENESS": "µm/m",
    "UT_SCALE_ERROR": "ppm",
    "UT_ANGLE": "degrees",
    "UT_FEEDRATE": "mm/min",
    "UT_SPEED": "mm/s",
    "UT_SERVO_MISMATCH": "ms",
    "UT_PERCENT": "%",
    "UT_RANKING": "1",
}
_HEADER = ("OPERATOR", "DATE_STARTED", "SERIAL_NUMBER", "LAST_CALIBRATED")  # elements whose text is told
_NAMED = ("MACHINE_TESTED", "TEST_SPEC")  # elements whose attribute NAME is told
_FEATURE = re.compile(r"<FEATURE\b[^<>]{0,500}\bNAME\s{0,9}=\s{0,9}[\"']AF_")
_LONGEST = 10_000  # characters of a text that is kept


class B5r(EvaluatedFormat):
    """The vendor's evaluation of a ball-bar test."""

    name = "b5r"
    words = "a ball-bar test as the vendor evaluated it"
    about = (
        "squareness, scale mismatch, straightness, backlash and what else was evaluated, in the file's units; a table, never a "
        f"campaign: the trace of the radius is in no public description. {FROM_DESCRIPTIONS}"
    )

    def recognises(self, text: str) -> bool:
        """XML with evaluated features."""
        return text.lstrip().startswith("<") and _FEATURE.search(text) is not None

    def evaluation(self, file: ForeignFile) -> Evaluation:
        """The features in the order of the file. Raises `InputError` for what is no XML, naming the line."""
        content = _Content(file)
        plane = content.planes[0] if len(set(content.planes)) == 1 else ""
        rows = [(name, own or plane, value, unit, kind) for name, own, value, unit, kind in content.features]
        return Evaluation({"values": "the vendor's evaluation, not volid's", **content.header}, COLUMNS, rows)


class _Content:
    """What an XML text holds, read as a stream, so that depth and size cost nothing: `header`, `planes`, `features`."""

    def __init__(self, file: ForeignFile) -> None:
        self.file = file
        self.header: dict[str, str] = {}
        self.planes: list[str] = []
        self.features: list[tuple[Any, ...]] = []
        self._open: list[tuple[str, dict[str, str]]] = []
        self._text = ""
        self._parser = expat.ParserCreate("utf-8")
        self._parser.StartDoctypeDeclHandler = self._refuse
        self._parser.StartElementHandler = self._start
        self._parser.EndElementHandler = self._end
        self._parser.CharacterDataHandler = self._characters
        try:
            self._parser.Parse(file.text.encode(), True)
        except expat.ExpatError as error:
            what = expat.errors.messages.get(error.code, "not well-formed")
            raise file.wrong(error.lineno, f"the XML is damaged: {what}", "the file as the program wrote it") from None

    def _refuse(self, *args: Any) -> None:
        raise self.file.wrong(
            self._parser.CurrentLineNumber, "a document type declaration, which can fill the memory", "XML without one"
        )

    def _start(self, name: str, attributes: dict[str, str]) -> None:
        self._open.append((name, attributes))
        self._text = ""
        if name == "PLANE" and attributes.get("TEST_PLANE"):
            self.planes.append(attributes["TEST_PLANE"])
        if name in _NAMED and attributes.get("NAME"):
            self.header.setdefault(name.lower(), attributes["NAME"])

    def _characters(self, text: str) -> None:
        self._text = (self._text + text)[:_LONGEST]

    def _end(self, name: str) -> None:
        _, attributes = self._open.pop()
        if name in _HEADER and self._text.strip():
            self.header.setdefault(name.lower(), self._text.strip())
        if name == "FEATURE":
            self._feature(attributes)
        self._text = ""

    def _feature(self, attributes: dict[str, str]) -> None:
        planes = [found["TEST_PLANE"] for name, found in self._open if name == "PLANE" and "TEST_PLANE" in found]
        kind, text = attributes.get("DT", ""), self._text.strip()
        value = number(text, decimal_of([text]) or ".")
        named = attributes.get("NAME", "")
        self.features.append(
            (named, "".join(planes[-1:]), text if value is None else value, _UNITS.get(kind, ""), kind)
        )


B5R: Format = B5r()
