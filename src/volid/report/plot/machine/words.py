"""What stands beside each body of the drawing: its travel, where its error motions are zero, its line, the tool vector."""

from __future__ import annotations

from collections.abc import Sequence

from volid.model.machine import Machine
from volid.report.language import Texts
from volid.report.plot.machine.layout import Body, layout
from volid.report.plot.panels import signs


def words_of(machine: Machine, tool: Sequence[float] | None, texts: Texts) -> dict[str, list[str]]:
    """Lines of text by the token of the structural code.

    Args:
        machine: The machine.
        tool: Tool vector, shape (3,) [mm]; None: not stated.
        texts: The language.
    """
    found = {body.token: _lines(body, texts) for body in layout(machine).bodies}
    if tool is not None:
        found["t"].append(texts("machine.vector", vector=triple(tool, texts)))
    return found


def _lines(body: Body, texts: Texts) -> list[str]:
    if body.axis is None:
        return [texts(f"machine.{body.role}", label=body.label)]
    axis, unit = body.axis, " mm" if body.axis.is_linear else "°"
    span = f"{number(axis.travel[0], texts)} … {number(axis.travel[1], texts)}{unit}"
    found = [f"{body.label}: {span}", texts("machine.zero", at=f"{number(axis.reference, texts)}{unit}")]
    if not axis.is_linear:
        found.append(texts("machine.line", point=triple(axis.point, texts)))
        if body.is_inclined:
            found.append(texts("machine.along", direction=triple(axis.unit_vector, texts)))
    return found


def number(value: float, texts: Texts) -> str:
    """A number with a real minus sign and the decimal sign of the language, at most three decimals."""
    return signs(f"{round(value, 3) + 0.0:.10g}", texts)


def triple(values: Sequence[float], texts: Texts) -> str:
    """Three numbers in brackets."""
    return f"({('; ' if texts.language == 'de' else ', ').join(number(v, texts) for v in values)})"
