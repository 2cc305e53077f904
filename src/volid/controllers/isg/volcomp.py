"""Volumetric compensation of the ISG kernel (TwinCAT CNC: TF5280), files of the format ISG_CSV with their list.

Two forms. A grid over X, Y, Z holds the position errors EXX, EYY, EZZ of the functional point for one tool vector; nothing about
it is a matter of convention. Component tables hold the functions of ISO 230 of each axis, which the control puts through its own
kinematic model, with lever arms and rotary axes; how it counts them is inferred (`volid.controllers.isg.iso_convention`). The
control corrects the position of the tool, never its orientation, and knows no direction of motion.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from volid.compensation.package import Compensation
from volid.compensation.types import GRID, TABLES
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
    Option,
    Written,
    text_of,
)
from volid.controllers.isg.iso_convention import FACTS, Convention, axis_errors
from volid.controllers.isg.iso_parameters import (
    OPTIONS,
    blocks_of,
    constant_block,
    lost_reversal,
    refuse_turns,
)
from volid.controllers.isg.iso_texts import begins_as_isg_csv, isg_csv
from volid.controllers.isg.kernel_lists import axis_numbers, entries, one_of
from volid.controllers.isg.volcomp_files import (
    CSV,
    FORMATS,
    LIST,
    ask_axes,
    compensation_of,
    grid_block,
    grid_notes,
    kinematics,
    list_text,
    named_files,
    plain,
    tool_notes,
)
from volid.controllers.turning import refuse_turning
from volid.exceptions import InputError
from volid.model.machine import Machine

AUTO, IN_P0, BY_CONTROL = "auto", "P0", "control"
_DOCS = "Beckhoff TF5280 (infosys.beckhoff.com, tf5280_volumetric_comp)"


def _index(text: str) -> int:
    if text not in ("0", "1", "2", "3", "4"):
        raise ValueError("expected 0 … 4, the number of the compensation")
    return int(text)


DECLARATION = Declaration(
    name="isg-volcomp",
    title="ISG kernel and TwinCAT CNC, volumetric compensation (TF5280, #VOLCOMP)",
    carries={
        "L-VOL": GRID,
        "R-VOL": TABLES,
        "L-ANG": TABLES,
        "L-POS": TABLES,
        "L-STR": TABLES,
        "L-SQU": TABLES,
        "R-POR": TABLES,
        "R-RAX": TABLES,
        "R-ANG": TABLES,
    },
    nearest="it corrects the position of the tool by X, Y, Z, not its orientation, and turns no rotary axis; L-VOL and "
    ""
    ""
    ""
    ""
    ""
    "R-VOL hold all "
    "that it can correct, and isg-ssfk carries R-POS",
    sign=ERROR,
    units="values mm and rad, arguments mm and degrees",
    reversal=NO_REVERSAL,
    outside=NOT_KNOWN,
    limits="as many rows in all as max_records says; 10 files of each of 5 compensations",
    zero="nowhere; a value other than 0 where the machine stands when it is switched on makes it move",
    switching="#VOLCOMP ON [ID0] and #VOLCOMP OFF [ID0], 0 being the number of option id; the types of one export are on and off "
    "together, because one number holds them all",
    model=True,
    options=(
        Option(
            "form",
            "grid: position errors over X, Y, Z for one tool vector; tables: functions of each axis, with "
            "lever arms; auto: a grid for "
            "L-VOL, tables where rotary axes take part",
            AUTO,
            one_of(AUTO, GRID, TABLES),
        ),
        Option(
            "axes",
            "logical axis numbers of the control, such as 'X=1 Y=2 Z=3'",
            "X=1 Y=2 Z=3 A=4 B=5 C=6",
            axis_numbers,
        ),
        Option("folder", "folder of the files on the control", "C:\\volcomp"),
        Option("id", "number of the compensation, 0 … 4", "0", _index),
        Option(
            "tool",
            "tables only. P0: the tool vector stands in P0X, P0Y, P0Z; control: these are 0, because the "
            "control adds its active tool",
            IN_P0,
            one_of(IN_P0, BY_CONTROL),
        ),
        *OPTIONS,
    ),
    commissioning=Commissioning(
        backup=(
            "Copy the startup list hochlauf.lis, the list that vol_comp[i].file_name names, and all files that "
            "it names.",
        ),
        load=(
            "Copy vol.csv and vol.lis into the folder that vol.lis names; compare the axis numbers in vol.lis "
            "with those of the control.",
            "Enter vol_comp[i].file_name and vol_comp[i].max_records in hochlauf.lis, and start the control "
            "again; later, "
            "#VOLCOMP OFF [ID0] and #VOLCOMP [ID0 UPDATE] read changed files.",
        ),
        activate=(
            "Reference all axes, and command #VOLCOMP ON [ID0] in the NC program (0: its number); a reset "
            "switches it off.",
            "Where one axis alone moves the wrong way in the one-point check, enter the line 'negate X' (its letter) "
            "in vol.lis.",
        ),
        remove=("Command #VOLCOMP OFF [ID0], and put the copied files back.",),
    ),
    facts=(
        Fact(
            "ISG_CSV: columns named in a header, // before a comment, # before a new header, any number of arguments",
            DOCUMENTED,
            f"{_DOCS}, 296429067",
        ),
        Fact(
            "EXX, EYY, EZZ over X, Y, Z in one file are a spatial grid; the vendor's own example has one, with "
            "workpiece_axes 0",
            DOCUMENTED,
            f"{_DOCS}, 1218769547",
        ),
        Fact(
            "GRID interpolates linearly, and positions that form no grid are an error (70471)",
            DOCUMENTED,
            "P-VOLC-00014; TF5200 diagnosis, 261286283",
        ),
        Fact(
            "three linear and at most three rotary axes; up to 5 compensations, of up to 10 files each; "
            "max_records bounds their rows",
            DOCUMENTED,
            f"{_DOCS}, 296390283",
        ),
        Fact("it corrects the position, not the orientation", DOCUMENTED, f"{_DOCS}, 296386187"),
        Fact(
            "it can be loaded from outside by ADS, index group 0x120100: file name 0x27C, load 0x27D, on "
            "0x291, off 0x292",
            DOCUMENTED,
            f"{_DOCS}, 1217092747",
        ),
        Fact("a reset switches it off; an update needs it off", DOCUMENTED, f"{_DOCS}, 296404875, 1218769547"),
        Fact("no dependence on the direction of motion: none is described", INFERRED, f"{_DOCS}, 296429067"),
        Fact(
            "P0X, P0Y, P0Z: position of the tool when all axes are at 0; whether the control adds the length "
            "of the active tool to it",
            OPEN,
        ),
        Fact("what happens beyond the first and last position", OPEN),
        *FACTS,
    ),
)


class IsgVolcomp(Controller):
    """Files of #VOLCOMP: one ISG_CSV file and its list."""

    declaration = DECLARATION

    def declared_for(self, machine: Machine, options: Mapping[str, Any]) -> Declaration:
        """Unless asked otherwise a grid for three linear axes alone, tables where rotary axes turn the tool or the table."""
        asked, plain = options["form"], all(a.is_linear for a in machine.axes)
        form = (GRID if plain else TABLES) if asked == AUTO else asked
        linear = ("L-VOL", "L-ANG", "L-POS", "L-STR", "L-SQU")
        carries = {n: form if n == "L-VOL" or (n in linear and asked == GRID) else TABLES for n in DECLARATION.carries}
        return replace(DECLARATION, carries=carries)

    def write(self, job: Job) -> Written:
        """`vol.csv` and `vol.lis`, and the two lines of the startup list."""
        machine, made = job.machine, job.compensation
        ask_axes(machine)
        if made.axis_tables:
            raise InputError(
                "isg-volcomp: tables of single axes do not go through its kinematic model; isg-ssfk carries them"
            )
        refuse_turns("isg-volcomp", made.tables, "isg-ssfk carries R-POS")
        if made.grids:
            refuse_turning("isg-volcomp", machine)
        convention = Convention(machine, job.options["table_errors"])
        blocks = [grid_block(g) for g in made.grids]
        notes = [n for g in made.grids for n in grid_notes(g)]
        if made.tables:
            tool = np.zeros(3) if job.options["tool"] == BY_CONTROL else job.tool
            blocks += constant_block(kinematics(convention, tool))
            notes += tool_notes(made.tables, tool)
            blocks += blocks_of(axis_errors(convention, made.tables), job.options["location_errors"])
            notes += lost_reversal(
                made.tables, "isg-ssfk with option values=reversal takes that of the positioning, beside these files"
            )
        if not blocks:
            raise InputError("isg-volcomp: nothing to write; expected grids or tables")
        records = sum(len(b.values) for b in blocks)
        files = (
            ControlFile(
                CSV,
                isg_csv(blocks, f"error values, actual - nominal [mm, rad]; machine {plain(machine.name)}"),
                "error parameters",
            ),
            ControlFile(LIST, list_text(machine, job.options, bool(made.tables)), "list of the compensation"),
        )
        path, i = f"{job.options['folder']}\\{LIST}", job.options["id"]
        parameters = (
            (f"vol_comp[{i}].file_name", path, "startup list: where the list of the compensation lies (P-STUP-00101)"),
            (
                f"vol_comp[{i}].max_records",
                str(records),
                "startup list: at least as many rows as the files have (P-STUP-00100)",
            ),
        )
        return Written(files, parameters, tuple(dict.fromkeys(notes)))

    def read(self, files: Mapping[str, str | bytes], machine: Machine, options: Mapping[str, Any]) -> Compensation:
        """Grids and tables of the files that the list names, or of all files where there is no list."""
        texts = {name: text_of(name, content) for name, content in files.items()}
        lists = [name for name in texts if name.lower().endswith(".lis")]
        if len(lists) > 1:
            raise InputError(
                f"{', '.join(lists)}: several lists; expected one, because each is a compensation of its own"
            )
        stated = entries(lists[0], texts[lists[0]]) if lists else {}
        blocks = [b for name, format_ in named_files(lists, stated, texts) for b in FORMATS[format_](name, texts[name])]
        return compensation_of(blocks, machine, options, stated)

    def recognises(self, name: str, content: str | bytes) -> bool:
        """A header of letters of axes and names of parameters, or a list that names such files."""
        text = text_of(name, content)[:20000]
        listed = any(line.strip().lower().startswith("file_format[") for line in text.splitlines())
        return listed or begins_as_isg_csv(text)


ISG_VOLCOMP = IsgVolcomp()
