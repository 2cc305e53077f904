"""Measurement results of a certificate: methods, instruments, conditions, and the numbers with their uncertainties.

An error motion is a list of three quantities: position of the axis, value with expanded uncertainty or coverage interval,
standard uncertainty. A constant is one number.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Mapping
from typing import Any

import numpy as np

from volid.io.functions_csv import round_place
from volid.model.iso230 import DIRECTIONS
from volid.report.certificate.element import add, add_list, add_real, add_texts, add_words, plain
from volid.report.contents.contents import Contents
from volid.report.contents.curves import Curve, curves, plain_symbol
from volid.report.contents.volume import volume_values
from volid.report.language import LANGUAGES, Texts
from volid.report.symbols import in_words


def add_results(part: ET.Element, contents: Contents) -> None:
    """`dcc:results` of a measurement result."""
    results = add(part, "results")
    found, summary = curves(contents.solution), contents.summary
    for axis in sorted(contents.solution.machine.axes, key=lambda a: DIRECTIONS.index(a.letter)):
        own = [c for c in found if c.error.axis == axis.letter]
        if own:
            data = _result(results, "motions", axis=axis.letter)
            for curve in own:
                _motion(data, curve, axis.unit)
    for key in ("squareness", "location_errors", "tool_frame"):
        if summary[key]:
            data = _result(results, key)
            for row in summary[key]:
                _constant(data, row)
    _volume(results, contents)


def _result(results: ET.Element, key: str, **values: Any) -> ET.Element:
    """The data of a new result with its name and what its numbers mean."""
    result = add(results, "result")
    add_texts(result, "name", f"{key}_name", **values)
    add_texts(result, "description", key, **values)
    return add(result, "data")


def ref_type(symbol: str) -> str:
    """The type of a quantity for machines: "iso230_EXX", the direction of approach and the carrier included.

    >>> ref_type("EXX (+)"), ref_type("EX(0A)C")
    ('iso230_EXX_plus', 'iso230_EX0C_to_A')
    """
    carrier = symbol.partition("(0")[2].partition(")")[0]
    name = plain_symbol(symbol) if len(carrier) == 1 else symbol
    name = name.replace(" (+)", "_plus").replace(" (−)", "_minus")
    return f"iso230_{name}" + (f"_to_{carrier}" if len(carrier) == 1 else "")


def _name(parent: ET.Element, symbol: str, name: str) -> None:
    """A symbol with its words in every language."""
    element = add(parent, "name")
    for language in LANGUAGES:
        add(element, "content", f"{symbol}: {in_words(name, Texts(language))}", lang=language)


def _motion(data: ET.Element, curve: Curve, unit: str) -> None:
    """A list: positions, values with U or coverage intervals, u. Positions without a value are left out, and said."""
    known = curve.known
    one = add(data, "list", refType=ref_type(curve.title))
    _name(one, curve.title, curve.name)
    if not known.all():
        add_texts(one, "description", "partly" if known.any() else "nowhere", count=int((~known).sum()))
    if not known.any():
        add_texts(add(one, "quantity"), "noQuantity", "not_determined")
        return
    positions = [round_place(float(x)) for x in curve.positions[known]]
    ends = () if curve.low is None or curve.high is None else (curve.low[known], curve.high[known])
    quantity = add(one, "quantity", refType="basic_nominalValue")
    add_texts(quantity, "name", "position", axis=curve.error.axis)
    add_list(quantity, positions, unit)
    quantity = add(one, "quantity", refType="basic_measuredValue")
    add_texts(quantity, "name", "value")
    add_list(quantity, curve.values[known].tolist(), curve.error.unit, curve.u[known].tolist(), ends)
    quantity = add(one, "quantity", refType="basic_measurementUncertainty")
    add_texts(quantity, "name", "standard_uncertainty")
    add_list(quantity, curve.u[known].tolist(), curve.error.unit)


def _constant(data: ET.Element, row: Mapping[str, Any]) -> None:
    symbol = row.get("symbol", row["name"])
    one = add(data, "quantity", refType=f"basic_measuredValue {ref_type(row['name'])}")
    _name(one, symbol, plain_symbol(row["name"]))
    if row.get("angle"):
        add_words(one, "description", row["angle"])
    if row["value"] is None:
        add_texts(one, "noQuantity", "not_determined")
    else:
        add_real(one, row["value"], row["unit"], row["U"])


def _volume(results: ET.Element, contents: Contents) -> None:
    """Volumetric accuracy and deviation for one tool vector, which stands before them."""
    data = _result(results, "volume")
    tool = add(data, "quantity", refType="volid_toolVector")
    add_texts(tool, "name", "tool_vector")
    add_list(tool, contents.tool, "mm")
    letters, volume = contents.solution.machine.letters, contents.summary["volume"]
    for v in volume_values(contents):
        one = add(data, "quantity", refType=f"basic_measuredValue {'iso230' if v.key[0] == 'V' else 'volid'}_{v.key}")
        add_texts(one, "name", f"volume_{v.key}")
        if v.place:
            place = ", ".join(f"{a} {p:g}" for a, p in zip(letters, v.place, strict=True))
            add_texts(one, "description", "volume_place", place=plain(place))
        if np.isnan(v.value):
            add_texts(one, "noQuantity", "not_determined_or_left_out")
        else:
            add_real(one, v.value, v.unit, v.U)
    if volume and volume["left_out"]:
        add_texts(data, "text", "left_out", names=", ".join(volume["left_out"]))
