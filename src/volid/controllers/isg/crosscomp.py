"""Cross and plane compensation of the ISG kernel (TwinCAT CNC), entries kw.crosscomp and kw.crosscomp2 of an axis.

An axis (the slave) is moved by the position of one other axis (cross compensation), and by that of two axes, one of which may be
itself (plane compensation), over a grid of equal steps that is the same for both. Each axis has one table of each kind: what it
needs must be a function of one pair of axes and of one further axis.

    correction of the slave = f(master) + g(master 1, master 2)

Public sources do not state the sign of these values. Values and positions are counted in 0.1 µm.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from volid.compensation.package import Compensation
from volid.compensation.tables.axis_table import AxisTable
from volid.compensation.types import TABLES
from volid.controllers.base import (
    COMPENSATION,
    DOCUMENTED,
    FREE,
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
    Option,
    Written,
    refuse_grids,
    refuse_points,
    text_of,
)
from volid.controllers.isg.crosscomp_lists import cross, parts_of, plane, read_cross, read_plane
from volid.controllers.isg.kernel_lists import (
    STEPS,
    axis_numbers,
    entries,
    header,
    lines,
    numbered_axis,
)
from volid.exceptions import InputError
from volid.model.machine import Machine

_DOCS = "Beckhoff TF5200 axis compensation (infosys.beckhoff.com, tf5200_axis_compensation)"
_PARAMETERS = "tf5200_axis_compensation_parameters"
MOST = 1000

DECLARATION = Declaration(
    name="isg-crosscomp",
    title="ISG kernel and TwinCAT CNC, cross and plane compensation (kw.crosscomp, kw.crosscomp2)",
    carries={"L-STR": TABLES, "L-SQU": TABLES, "L-ANG": TABLES},
    nearest="kw.crosscomp moves an axis by the position of others; isg-ssfk carries the positioning of each axis, isg-volcomp "
    "the whole volume",
    sign=OPEN,
    units="0.1 µm, positions and values",
    reversal=NO_REVERSAL,
    outside=NOT_KNOWN,
    spacing=FREE,
    quantum=(1.0 / STEPS, float(np.deg2rad(1.0 / STEPS))),
    most_points=MOST,
    limits="101 along each master of a plane",
    products=True,
    zero="make the values 0 at the reference position of the masters: the compensation acts once they are referenced",
    switching="lr_param.crosscomp and lr_param.crosscomp2 of the slave, and X [COMP OFF CROSS], X [COMP OFF PLANE] in "
    "the NC program",
    options=(
        Option(
            "axes",
            "logical axis numbers of the control, such as 'X=1 Y=2 Z=3'",
            "X=1 Y=2 Z=3 A=4 B=5 C=6",
            axis_numbers,
        ),
    ),
    commissioning=Commissioning(
        backup=("Copy the compensation list and the parameter list of each axis.",),
        load=(
            "Put the lines of the file into the compensation list of the axis that it names, instead of its "
            "lines kw.crosscomp and "
            "kw.crosscomp2; compare the numbers of the axes.",
        ),
        activate=(
            "Set lr_param.crosscomp (and lr_param.crosscomp2, where the file has kw.crosscomp2) to 1 in the "
            "parameter list of that axis.",
            "Start the control again, or read the lists again, and reference all axes.",
        ),
        remove=("Set lr_param.crosscomp and lr_param.crosscomp2 to 0, or put the copied lists back.",),
    ),
    facts=(
        Fact(
            "the sign: pages speak of a relative compensation value for the slave axis, without a sense",
            OPEN,
            f"{_PARAMETERS}, 113389963, 113416075",
        ),
        Fact(
            "both are activated in the parameters of the slave; older pages put the data of cross compensation "
            "into the "
            "list of the master",
            DOCUMENTED,
            f"{_DOCS}, 308709003, 308720651; {_PARAMETERS}, 113377675",
        ),
        Fact(
            "the table of cross compensation holds for both directions, and last_index is smaller than "
            "max_points, 1001 "
            "by default",
            DOCUMENTED,
            "tccncaxiscompensation, 15273965963; P-COMP-00060",
        ),
        Fact(
            "table[j][i] of plane compensation: j counts along master 2, i along master 1, in equal steps; "
            "linear between "
            "four nodes",
            DOCUMENTED,
            f"{_PARAMETERS}, 113416075; axiscompensation, 15327290891",
        ),
        Fact("beyond a plane table its margin stays valid", DOCUMENTED, "axiscompensation, 15327290891"),
        Fact("10201 nodes by default, 101 along each master", DOCUMENTED, f"{_DOCS}, 308723339"),
        Fact(
            "cross and plane compensation of one axis add up", INFERRED, f"{_DOCS}: each has its own table and switch"
        ),
        Fact("what happens beyond a table of cross compensation", OPEN),
    ),
)


class IsgCrosscomp(Controller):
    """One list per slave axis."""

    declaration = DECLARATION

    def write(self, job: Job) -> Written:
        """The lines kw.crosscomp and kw.crosscomp2 of each axis, one file per axis."""
        refuse_grids(DECLARATION, job.compensation, "isg-volcomp")
        files, notes, parameters, lost = [], [], [], 0.0
        made = job.axis_tables(products=True)
        for table in made:
            refuse_points(DECLARATION, f"the table of {table.output} over {table.argument}", len(table.positions))
        for letter in dict.fromkeys(t.output for t in made):
            parts = parts_of([t for t in made if t.output == letter], letter)
            axis = job.machine.axis(letter)
            found = [cross(job, axis, parts.cross)] if parts.cross else []
            found += [plane(job, axis, parts)] if parts.plane else []
            text = lines([*header(axis, job.options["axes"]), *(row for f in found for row in f.rows)])
            files.append(ControlFile(f"{letter.lower()}_crosscomp.lis", text, f"what moves {letter} by other axes"))
            parameters += [(f"{f.switch} of {letter}", "1", f"{f.words} on ({f.parameter})") for f in found]
            notes += [n for f in found for n in f.notes]
            lost = max([lost, *(f.rounding for f in found)])
        if not files:
            raise InputError("isg-crosscomp: nothing to write; expected tables that move an axis by another one")
        if any(t.has_reversal for t in made):
            notes.append("The lists know no direction of motion: they hold the mean of both.")
        return Written(tuple(files), tuple(parameters), tuple(notes), lost)

    def read(self, files: Mapping[str, str | bytes], machine: Machine, options: Mapping[str, Any]) -> Compensation:
        """Tables of the slaves; a plane is a sum of products, each of which is 1 at one position of a master."""
        found: list[AxisTable] = []
        factor = -1.0 if options["sign"] == COMPENSATION else 1.0
        for name, content in files.items():
            stated = entries(name, text_of(name, content))
            owner = numbered_axis(name, stated, machine, options["axes"])
            one = [
                *read_cross(name, stated, machine, options["axes"], owner),
                *read_plane(name, stated, machine, options["axes"], owner),
            ]
            if not one:
                raise InputError(
                    f"{name}: no lines kw.crosscomp or kw.crosscomp2; expected a list of cross compensation"
                )
            found += one
        scaled = (
            AxisTable(t.output, t.argument, t.positions, factor * t.forward, factor * t.reverse, t.factor)
            for t in found
        )
        return Compensation((), (), (), tuple(scaled))

    def recognises(self, name: str, content: str | bytes) -> bool:
        """A line that begins with kw.crosscomp."""
        return any(
            line.lstrip().lower().startswith("kw.crosscomp") for line in text_of(name, content)[:20000].splitlines()
        )


ISG_CROSSCOMP = IsgCrosscomp()
