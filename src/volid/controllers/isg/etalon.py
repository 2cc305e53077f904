"""The exchange text of ETALON, variant "Vendor": functions and location errors under their names of ISO 230.

A text between programs rather than a control: it goes into the kernel of ISG (file_format ETALON_EXCHANGE of its volumetric
compensation) and into other tools. It holds functions of an axis's own position and constants, for one direction; the order of
the axes and the tool stand elsewhere. How the numbers relate to volid's is inferred, as for the component tables of the kernel.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

from volid.compensation.package import Compensation
from volid.compensation.types import TABLES
from volid.controllers.base import (
    DOCUMENTED,
    ERROR,
    INFERRED,
    NO_REVERSAL,
    NOT_KNOWN,
    OPEN,
    Commissioning,
    ControlFile,
    Controller,
    Declaration,
    Fact,
    Job,
    Written,
    text_of,
)
from volid.controllers.isg.iso_convention import FACTS, Convention, axis_errors
from volid.controllers.isg.iso_parameters import OPTIONS, blocks_of, lost_reversal, refuse_turns, tables_of
from volid.controllers.isg.iso_texts import etalon, read_etalon
from volid.exceptions import InputError
from volid.model.iso230 import ROTARY_AXES
from volid.model.machine import Axis, Machine

FILE = "etalon.txt"
_DOCS = "Beckhoff TF5280, 296430091"

DECLARATION = Declaration(
    name="etalon",
    title="exchange text of ETALON (variant Vendor)",
    carries={
        "L-VOL": TABLES,
        "R-VOL": TABLES,
        "L-ANG": TABLES,
        "L-POS": TABLES,
        "L-STR": TABLES,
        "L-SQU": TABLES,
        "R-POR": TABLES,
        "R-RAX": TABLES,
        "R-ANG": TABLES,
    },
    nearest="it holds functions of single axes for a kinematic model; L-VOL and R-VOL hold all of them, and "
    "isg-volcomp carries "
    "spatial grids",
    sign=ERROR,
    units="values mm and rad, arguments mm and degrees",
    reversal=NO_REVERSAL,
    outside=NOT_KNOWN,
    limits="as many as the control that reads it takes",
    zero="nowhere",
    switching="by the control that reads it; leave a section out, and that function is off",
    model=True,
    options=OPTIONS,
    commissioning=Commissioning(
        backup=("Copy the file of parameters that the control holds.",),
        load=(
            "Give the file to the program that reads it; it was written as the variant Vendor.",
            "State there the order of the axes, the centres of rotation and the tool, which the file does not hold.",
        ),
        activate=("Activate it as the control that reads it says.",),
        remove=("Put the copied file back.",),
    ),
    facts=(
        Fact(
            "[name] and VALUE = for a constant, Gridpoints = { argument value … } for a function, // before a comment",
            DOCUMENTED,
            _DOCS,
        ),
        Fact("the variant must be Vendor, not Kinematic, where the kernel of ISG reads it", DOCUMENTED, _DOCS),
        Fact("a function has one direction: none is described for two", INFERRED, _DOCS),
        Fact("what happens beyond the first and last position", OPEN),
        *FACTS,
    ),
)


class Etalon(Controller):
    """One text file."""

    declaration = DECLARATION

    def write(self, job: Job) -> Written:
        """`etalon.txt`."""
        made = job.compensation
        if made.grids or made.axis_tables:
            raise InputError(
                "etalon: the text holds functions of single axes for a kinematic model, no grids and no tables "
                "of what moves an "
                "axis; isg-volcomp carries grids, csv both"
            )
        refuse_turns("etalon", made.tables, "isg-ssfk carries R-POS")
        if not made.tables:
            raise InputError("etalon: nothing to write; expected tables of error functions")
        found = axis_errors(Convention(job.machine, job.options["table_errors"]), made.tables)
        text = etalon(blocks_of(found, job.options["location_errors"]), "error values, actual - nominal [mm, rad]")
        chain = "".join(job.machine.letters)
        centres = [a for a in job.machine.axes if not a.is_linear]
        points = "; ".join(f"{a.letter} about ({', '.join(f'{v:g}' for v in a.point)}) mm{_line(a)}" for a in centres)
        notes = (f"Axes from workpiece to tool, not in the file: {chain}" + (f"; {points}" if points else "") + ".",)
        lost = lost_reversal(made.tables, "a control with two directions takes the positioning in both")
        return Written((ControlFile(FILE, text, "functions and location errors"),), (), notes + lost)

    def read(self, files: Mapping[str, str | bytes], machine: Machine, options: Mapping[str, Any]) -> Compensation:
        """Functions of the texts; constants are added to the functions of their axis."""
        blocks = [b for name, content in files.items() for b in read_etalon(name, text_of(name, content))]
        errors = [b for b in blocks if b.names[0][0] == "E" or b.names[0][0] not in "PNV"]
        if len(errors) < len(blocks):
            other = next(b for b in blocks if b not in errors)
            raise InputError(
                f"{other.where}: [{other.names[0]}] describes the machine; expected errors alone, such as EXX or C0Y"
            )
        return Compensation((), tables_of(Convention(machine, options["table_errors"]), errors), ())

    def recognises(self, name: str, content: str | bytes) -> bool:
        """A section with VALUE or Gridpoints."""
        head = text_of(name, content)[:4000]
        return bool(re.search(r"^\s*\[\w{3}\]\s*(//.*)?\n\s*(VALUE|Gridpoints)\s*=", head, re.MULTILINE))


def _line(axis: Axis) -> str:
    """The direction of a rotary axis's line, where it is not that of its letter."""
    plain = tuple(float(axis.letter == a) for a in ROTARY_AXES)
    return "" if axis.unit_vector == plain else f" along ({', '.join(f'{v:g}' for v in axis.unit_vector)})"


ETALON = Etalon()
