"""HEIDENHAIN: KinematicsComp of the iTNC 530 HSCI, columns C1 … C6 of .COM tables and error lines of the kinematics table.

A .COM of each axis holds its positioning in the column of the axis, as ever, and its other five errors in C1 … C6, in the order
X Y Z A B C of their components; lines `Trans` of the kinematics table put them into the chain. The control corrects the position
of the tool centre point for any tool, not the orientation. Constants (location errors of rotary axes, the tool frame) stand as
numbers in COMPTAB. The kinematics table belongs to the machine: what volid writes is a proposal for a person to enter.

Not modelled: reversal of C1 … C6, which have one value; lever arms of nominal offsets that the machine's own table has elsewhere.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from volid.compensation.package import Compensation
from volid.compensation.types import TABLES
from volid.controllers.base import (
    COLUMNS,
    COMPENSATION,
    DOCUMENTED,
    FREE,
    INFERRED,
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
from volid.controllers.heidenhain.assignment import (
    AXES,
    CAUSE,
    CMA,
    DECIMALS,
    ITNC,
    MANUALPLUS,
    ROWS,
    TURN,
    assignment,
    com_name,
    tables_by_cause,
)
from volid.controllers.heidenhain.chain import KINEMATICS, Constant, Reference, errors_of, lines
from volid.controllers.heidenhain.functions import (
    ANGLE_DIGITS,
    Com,
    constant_of,
    error_of,
    filled,
    is_constant,
    own_column,
    positioning,
)
from volid.controllers.heidenhain.table import FRAME, begins, has_columns_c, head_of, parse
from volid.exceptions import InputError
from volid.model.iso230 import SPINDLE
from volid.model.machine import Machine

DECLARATION = Declaration(
    name="heidenhain-kinematicscomp",
    title="HEIDENHAIN iTNC 530 HSCI, KinematicsComp (.COM columns C1 … C6)",
    carries={
        "L-VOL": TABLES,
        "L-ANG": TABLES,
        "L-SQU": TABLES,
        "L-STR": TABLES,
        "L-POS": TABLES,
        "R-POR": TABLES,
        "R-RAX": TABLES,
        "R-ANG": TABLES,
        "R-POS": TABLES,
    },
    nearest="KinematicsComp corrects the position of the tool centre point by functions of one axis, not the orientation, and "
    "takes no grids; isg-volcomp takes grids",
    sign=OPEN,
    units="mm, degrees for rotary axes and for C4 … C6",
    reversal=COLUMNS,
    outside=NOT_KNOWN,
    spacing=FREE,
    quantum=(1e-4, float(np.deg2rad(10.0**-ANGLE_DIGITS))),
    most_points=256,
    limits="at most 100 entries of COMPTAB and 50 of COORD",
    model=True,
    zero="make the values 0 at the home position of the axis (`zero`), else the chain is not nominal there",
    switching="positioning by the line with * in ACTIVE of the .CMA; the other errors by choosing a kinematics table with or "
    "without the error lines",
    options=(AXES, ROWS, CAUSE, TURN, DECIMALS),
    commissioning=Commissioning(
        backup=("Copy the kinematics tables, all .COM and .CMA files and the machine parameters.",),
        load=(
            "Copy the .COM files and CONFIG.CMA to where the control has its own.",
            f"Make a copy of the machine's kinematics table in the description format, and enter the lines of {KINEMATICS} that "
            "have an entry in COMPTAB at the places where they stand between the lines MachAxis. The machine's own lines Trans "
            "with COORD stay; an error line must stand where the chain's origin is the machine origin (linear axes) or the "
            "centre of the axis (rotary axes).",
            "Check in the editor how COMPTAB names a column; the manual's print shows A..C4.",
        ),
        activate=(
            "Choose nonlinear compensation for the axes (MP730), the line of the .CMA, and the new kinematics.",
            "Load one error first, by the sign check, before all others: the sense of the lines is not stated.",
        ),
        remove=("Choose the former kinematics and the former line of the .CMA.",),
    ),
    facts=(
        Fact(
            "errors of ISO 230-1 in columns C1 … C6 of the .COM, positioning in columns 1-18",
            DOCUMENTED,
            f"{ITNC} pp. 680, 686",
        ),
        Fact("lines Trans with COMPTAB: a reference to a column, or a constant", DOCUMENTED, f"{ITNC} pp. 671, 684"),
        Fact("the chain starts at the tool reference point", DOCUMENTED, f"{ITNC} p. 722"),
        Fact("the position of the tool centre point is corrected", DOCUMENTED, f"{ITNC} p. 671"),
        Fact("at most 100 entries of COMPTAB, MachAxis lines included, and 50 of COORD", DOCUMENTED, f"{ITNC} p. 686"),
        Fact("inverse lines may be left out where all axes are known", DOCUMENTED, f"{ITNC} p. 686"),
        Fact(
            "the manual recommends errors before their axis; volid writes them on the side where ISO counts them",
            INFERRED,
            ITNC,
        ),
        Fact("the rate of the compensation depends on MP4070", DOCUMENTED, f"{ITNC} p. 671"),
        Fact(
            "values in negative direction in BACKLASH, of the axis's own column", INFERRED, f"from {MANUALPLUS} p. 716"
        ),
        Fact(
            "were COMPTAB added to the shift of its line as COORD is, +e would take the tool point back by e: the lines would "
            "want `sign=compensation`",
            INFERRED,
            f"example in {ITNC} p. 670: Trans Z 250.051 leads from the tool to the axis B of a head",
        ),
        Fact("C4 … C6 are in degrees", INFERRED, f"from Trans of rotations by COORD in {ITNC} p. 722"),
        Fact(
            "whether a positive entry is the error or its correction, and how COMPTAB names a column: not stated", OPEN
        ),
        Fact("frame of the files, BEGIN … [END]", INFERRED, FRAME),
        Fact("TNC 640 and TNC 7: no public format found", OPEN),
    ),
)


class HeidenhainKinematicsComp(Controller):
    """A .COM for each axis, the .CMA, and the proposed lines of the kinematics table."""

    declaration = DECLARATION

    def write(self, job: Job) -> Written:
        """The tables and the proposal. Raises `InputError` for what they cannot hold."""
        if job.compensation.axis_tables or job.compensation.grids:
            raise InputError(
                f"{DECLARATION.name}: tables of axes and grids are none of error functions: {DECLARATION.nearest}"
            )
        errors, coms = _parted(job)
        files = [ControlFile(com_name(a), c.text(), f"errors of {a}") for a, c in coms.items()]
        if coms:
            files.append(ControlFile(CMA, assignment(tuple(coms), job.options["axes"]), "assignment"))
        if any(errors.values()):
            text = lines(job.machine, errors, job.options["axes"], job.options["decimals"])
            files.append(ControlFile(KINEMATICS, text, "proposed lines of the kinematics table, to be entered by hand"))
        parameters = tuple((f"MP730, bit of {a}", "1", "nonlinear axis error compensation") for a in coms)
        notes = [n for c in coms.values() for n in c.notes()]
        for axis in (a for a in job.machine.axes if errors[a.letter] and not a.is_linear and any(a.point)):
            place = ", ".join(f"{v:g}" for v in axis.point)
            notes.append(f"the lines of {axis.letter} stand where the chain's origin is at {place} mm")
        return Written(tuple(files), parameters, tuple(notes), 0.5 * 10.0 ** -job.options["decimals"])

    def read(self, files: Mapping[str, str | bytes], machine: Machine, options: Mapping[str, Any]) -> Compensation:
        """Tables of error functions. Raises `InputError` that names file and line."""
        chains = {n: parse(n, text_of(n, c)) for n, c in files.items() if n.upper().endswith(".TAB")}
        if len(chains) > 1:
            raise InputError(f"{', '.join(chains)}: expected one kinematics table")
        acting = [e for n, t in chains.items() for e in errors_of(n, t, machine, options["axes"])]
        alone = bool(acting) and len(files) == len(chains)  # constants need no table
        coms = [] if alone else tables_by_cause(files, machine, options["axes"], options["cause"])
        sense = -1.0 if options["sign"] == COMPENSATION else 1.0
        held = {axis.letter: (axis, name, table) for axis, name, table in coms}
        if not chains:
            acting = [(a, Reference(f"E{'XYZABC'[k - 1]}{a}", k)) for a, (_, _, t) in held.items() for k in filled(t)]
        found = [t for axis, name, table in coms for t in positioning(axis, name, table, options["axes"])]
        found += [error_of(letter, e, held, machine, sense) for letter, e in acting]
        return Compensation((), tuple(found), ())

    def recognises(self, name: str, content: str | bytes) -> bool:
        """Whether a table .COM with columns C1 … C6 begins, or a kinematics table with COMPTAB."""
        return (begins(content, "COM") and has_columns_c(content)) or (
            begins(content, "TAB") and "COMPTAB" in head_of(content)
        )


def _parted(job: Job) -> tuple[dict[str, list[Constant | Reference]], dict[str, Com]]:
    """Lines of the chain by axis letter, and the tables of the axes that need one: what is the same everywhere needs none."""
    errors: dict[str, list[Constant | Reference]] = {}
    coms: dict[str, Com] = {}
    for axis in job.machine.axes:
        own = [t for t in job.compensation.tables if t.axis == axis.letter]
        functions = [t for t in own if own_column(t) is None or not is_constant(t)]
        errors[axis.letter] = [constant_of(t, job) for t in own if t not in functions]
        errors[axis.letter] += [Reference(t.function, c) for t in functions if (c := own_column(t)) is not None]
        if functions:
            coms[axis.letter] = Com(axis, functions, job)
    errors[SPINDLE] = [constant_of(t, job) for t in job.compensation.tables if t.axis == SPINDLE]
    return errors, coms


HEIDENHAIN_KINEMATICSCOMP = HeidenhainKinematicsComp()
