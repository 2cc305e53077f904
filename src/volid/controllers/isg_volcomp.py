"""Volumetric compensation of the ISG kernel (TwinCAT CNC: TF5280), files of the format ISG_CSV with their list.

Two forms. A grid over X, Y, Z holds the position errors EXX, EYY, EZZ of the functional point for one tool vector; nothing about
it is a matter of convention. Component tables hold the functions of ISO 230 of each axis, which the control puts through its own
kinematic model, with lever arms and rotary axes; how it counts them is inferred (`volid.controllers.iso_convention`). The control
corrects the position of the tool, never its orientation, and knows no direction of motion.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from volid.compensation.grids.grid import AnyGrid, Grid
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
from volid.controllers.iso_convention import FACTS, Convention, axis_errors, table_axes
from volid.controllers.iso_parameters import (
    OPTIONS,
    blocks_of,
    constant_block,
    grid_of,
    lost_reversal,
    one_of,
    refuse_turns,
    tables_of,
)
from volid.controllers.iso_texts import ARGUMENTS, Block, isg_csv, read_etalon, read_isg_csv
from volid.controllers.kernel_lists import Entry, axis_numbers, entries, lines, needed
from volid.exceptions import InputError
from volid.model.iso230 import LINEAR_AXES, ROTARY_AXES
from volid.model.machine import Machine

AUTO = "auto"
CSV, LIST = "vol.csv", "vol.lis"
FORMATS = {"ISG_CSV": read_isg_csv, "ETALON_EXCHANGE": read_etalon}
_CENTRE = re.compile(r"P[XYZ][ABC]")
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
    "R-VOL hold all "
    "that it can correct, and isg-ssfk carries R-POS",
    sign=ERROR,
    units="values mm and rad, arguments mm and degrees",
    reversal=NO_REVERSAL,
    outside=NOT_KNOWN,
    zero="nowhere; a value other than 0 where the machine stands when it is switched on makes it move",
    switching="#VOLCOMP ON [ID0] and #VOLCOMP OFF [ID0]; each of up to five compensations by its number",
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
            "Reference all axes, and command #VOLCOMP ON [ID0] in the NC program; a reset switches it off.",
            "Where an axis moves the wrong way in the one-point check, enter the line 'negate X' (its letter) "
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
        _ask_axes(machine)
        if made.axis_tables:
            raise InputError(
                "isg-volcomp: tables of single axes do not go through its kinematic model; isg-ssfk carries them"
            )
        refuse_turns("isg-volcomp", made.tables, "isg-ssfk carries R-POS")
        convention = Convention(machine, job.options["table_errors"])
        blocks = [_grid_block(g) for g in made.grids]
        notes = [n for g in made.grids for n in _grid_notes(g)]
        if made.tables:
            blocks += constant_block(_kinematics(convention, job.tool))
            blocks += blocks_of(axis_errors(convention, made.tables), job.options["location_errors"])
            notes += lost_reversal(made.tables, "isg-ssfk takes the positioning in both directions")
        if not blocks:
            raise InputError("isg-volcomp: nothing to write; expected grids or tables")
        records = sum(len(b.values) for b in blocks)
        files = (
            ControlFile(
                CSV,
                isg_csv(blocks, f"error values, actual - nominal [mm, rad]; machine {_plain(machine.name)}"),
                "error parameters",
            ),
            ControlFile(LIST, _list(machine, job.options, bool(made.tables)), "list of the compensation"),
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
        blocks = [b for name, format_ in _named(lists, stated, texts) for b in FORMATS[format_](name, texts[name])]
        return _compensation(blocks, machine, options, stated)

    def recognises(self, name: str, content: str | bytes) -> bool:
        """A header of letters of axes and names of parameters, or a list that names such files."""
        head = [line.split("//")[0].split() for line in text_of(name, content)[:4000].splitlines()]
        first = next((words for words in head if words), [])
        listed = any(words[0].lower().startswith("file_format[") for words in head if words)
        return listed or (
            len(first) > 1 and first[0] in ARGUMENTS and all(w in ARGUMENTS or w[0] == "E" for w in first)
        )


# ------------------------------------------------------------------------------------------------ writing


def _plain(text: str) -> str:
    return re.sub(r"[^\w .,()-]", "", text)


def _ask_axes(machine: Machine) -> None:
    linear = {a.letter for a in machine.linear}
    if linear != set(LINEAR_AXES) or len(machine.axes) > 6:
        raise InputError(
            f"isg-volcomp: machine '{machine.name}' has the axes {', '.join(machine.letters)}; the control asks "
            f"for exactly X, Y, Z and "
            "at most three rotary axes"
        )


def _grid_block(grid: AnyGrid) -> Block:
    if not isinstance(grid, Grid):
        raise InputError(
            f"isg-volcomp: a grid over {', '.join(grid.axes)} with lever arms cannot be written: its tables are "
            f"functions of single axes "
            "and translations over X, Y, Z. Take option form=tables"
        )
    blank = np.isnan(grid.values[:, :3]).any(axis=1)
    if blank.any():
        raise InputError(
            f"isg-volcomp: {blank.sum()} of {len(blank)} nodes of the grid are not determined, and the control "
            f"wants every node; "
            "restrict `ranges` to what was measured"
        )
    return Block(grid.axes, ("EXX", "EYY", "EZZ"), grid.positions, grid.values[:, :3], "")


def _grid_notes(grid: AnyGrid) -> tuple[str, ...]:
    if not np.nan_to_num(grid.values[:, 3:]).any():
        return ()
    tool = ", ".join(f"{v:g}" for v in grid.reference)
    turn = float(np.abs(np.nan_to_num(grid.values[:, 3:])).max())
    return (
        f"The grid holds for the tool vector ({tool}) mm alone, because the control adds no lever arm: 100 mm "
        f"of another tool are wrong "
        f"by up to {1e5 * turn:.2g} µm. Option form=tables has lever arms.",
    )


def _kinematics(convention: Convention, tool: np.ndarray) -> dict[str, float]:
    """Where the tool and the centres of rotation stand, and lines of rotary axes other than X, Y, Z."""
    found = {f"P0{c}": float(v) for c, v in zip(LINEAR_AXES, tool, strict=True)}
    for axis in (a for a in convention.machine.axes if not a.is_linear):
        found |= {f"P{c}{axis.letter}": float(v) for c, v in zip(LINEAR_AXES, axis.point, strict=True)}
        if tuple(axis.unit_vector) != _own_line(axis.letter):
            found |= {f"V{c}{axis.letter}": float(v) for c, v in zip(LINEAR_AXES, axis.unit_vector, strict=True)}
    return found


def _own_line(letter: str) -> tuple[float, ...]:
    return tuple(float(letter == a) for a in ROTARY_AXES)


def _list(machine: Machine, options: Mapping[str, Any], with_model: bool) -> str:
    """Text of the list of the compensation."""
    letters = machine.letters if with_model else LINEAR_AXES
    missing = [a for a in letters if a not in options["axes"]]
    if missing:
        raise InputError(
            f"isg-volcomp: option axes states no axis number of {', '.join(missing)}; such as 'X=1 Y=2 Z=3'"
        )
    return lines(
        [(a.lower(), options["axes"][a]) for a in ARGUMENTS if a in letters]
        + [("chain", "".join(letters)), ("workpiece_axes", len(table_axes(machine)) if with_model else 0)]
        + [("interpolation", "GRID"), ("file[0]", f"{options['folder']}\\{CSV}"), ("file_format[0]", "ISG_CSV")]
    )


# ------------------------------------------------------------------------------------------------ reading


def _named(lists: Sequence[str], stated: Mapping[str, Entry], texts: Mapping[str, str]) -> list[tuple[str, str]]:
    """Files of parameters with their format."""
    if not lists:
        return [(n, "ETALON_EXCHANGE" if t.lstrip().startswith("[") else "ISG_CSV") for n, t in texts.items()]
    have = {re.split(r"[\\/]", name)[-1].lower(): name for name in texts}
    needed(lists[0], dict(stated), "file[0]")
    found = []
    for key in (k for k in stated if k.startswith("file[")):
        name = re.split(r"[\\/]", stated[key].value)[-1].lower()
        if name not in have:
            raise InputError(
                f"{stated[key].where} names {stated[key].value}, which is not among the files; give it too"
            )
        kind = stated.get(key.replace("file", "file_format", 1))
        if kind is not None and kind.value not in FORMATS:
            raise InputError(f"{kind.where} is '{kind.value}'; expected {' or '.join(FORMATS)}")
        found.append((have[name], "ISG_CSV" if kind is None else kind.value))
    return found


def _compensation(
    blocks: Sequence[Block], machine: Machine, options: Mapping[str, Any], stated: dict[str, Entry]
) -> Compensation:
    over_space = [b for b in blocks if _is_grid(b)]
    of_axes = [b for b in blocks if not _is_grid(b)]
    errors, convention = _without_kinematics(of_axes, machine, options)
    flipped = _letters(stated, "negate")
    gone = _letters(stated, "set_to_zero")
    if errors and stated:
        _check_chain(stated, machine)
    if errors and gone | flipped not in (set(), set(LINEAR_AXES)):
        where = stated["negate" if flipped else "set_to_zero"].where
        raise InputError(
            f"{where}: tables with lever arms move all of X, Y, Z together; volid cannot turn single ones. Take it out"
        )
    scale = np.array([0.0 if a in gone else -1.0 if a in flipped else 1.0 for a in LINEAR_AXES])
    grids = [
        replace(g, values=g.values * np.hstack([scale, np.ones(3)])) for g in (grid_of(machine, b) for b in over_space)
    ]
    tables = tables_of(convention, errors) if errors else ()
    tables = tuple(replace(t, forward=scale[0] * t.forward, reverse=scale[0] * t.reverse) for t in tables)
    return Compensation((), tables, tuple(grids))


def _is_grid(block: Block) -> bool:
    """Whether a block holds translations over linear axes, others than functions of the axis's own position alone."""
    own = len(block.arguments) == 1 and all(n[0] == "E" and n[-1] == block.arguments[0] for n in block.names)
    if block.is_constant or own:
        return False
    plain = all(n[0] == "E" and n[1] in LINEAR_AXES and n[2] in LINEAR_AXES for n in block.names)
    if not plain or not set(block.arguments) <= set(LINEAR_AXES):
        raise InputError(
            f"{block.where}: {' '.join(block.names)} over {' '.join(block.arguments)}; volid holds functions of "
            f"the axis's own position, "
            "and translations of X, Y, Z over positions of X, Y, Z"
        )
    return True


def _without_kinematics(
    blocks: Sequence[Block], machine: Machine, options: Mapping[str, Any]
) -> tuple[list[Block], Convention]:
    """Blocks of errors alone, and the convention with the centres of rotation that the blocks state."""
    centres: dict[str, np.ndarray] = {a.letter: np.asarray(a.point, dtype=float).copy() for a in machine.axes}
    errors = []
    for b in blocks:
        keep = [k for k, n in enumerate(b.names) if n[0] == "E" or (n[1] == "0" and n[0] not in "PN")]
        for name, value in zip(b.names, b.values[0], strict=True):
            if _CENTRE.fullmatch(name) and name[2] in centres:
                centres[name[2]][LINEAR_AXES.index(name[1])] = value
            if name[0] == "V":
                _check_line(b, name, float(value), machine)
        if keep:
            errors.append(Block(b.arguments, tuple(b.names[k] for k in keep), b.at, b.values[:, keep], b.where))
    return errors, Convention(machine, options["table_errors"], centres)


def _check_line(block: Block, name: str, value: float, machine: Machine) -> None:
    wanted = machine.axis(name[2]).unit_vector[LINEAR_AXES.index(name[1])]
    if abs(value - wanted) > 1e-6:
        raise InputError(f"{block.where}: {name} = {value:g}; the machine's axis {name[2]} has {wanted:g} there")


def _letters(stated: Mapping[str, Entry], key: str) -> set[str]:
    """The axes that a set such as "XY" of the list names."""
    entry = stated.get(key)
    if entry is None:
        return set()
    found = set(entry.value.upper())
    if not found <= set(LINEAR_AXES):
        raise InputError(f"{entry.where} is '{entry.value}'; expected letters of X, Y, Z, such as XY")
    return found


def _check_chain(stated: dict[str, Entry], machine: Machine) -> None:
    """The chain of the list and its workpiece axes are those of the machine."""
    chain, wanted = stated.get("chain", Entry("XYZ", "the list, chain (by default)")), "".join(machine.letters)
    if chain.value.upper() != wanted:
        raise InputError(f"{chain.where} is '{chain.value}'; the machine's axes from workpiece to tool are {wanted}")
    carried, own = (
        stated.get("workpiece_axes", Entry("0", "the list, workpiece_axes (by default)")),
        len(table_axes(machine)),
    )
    if carried.whole(0, 5) != own:
        raise InputError(
            f"{carried.where} is {carried.value}; expected {own}, the rotary axes of the table. volid cannot "
            f"tell whose errors those of "
            "other axes of the workpiece side are"
        )
    alternative = stated.get("alternative_model")
    if alternative is not None and alternative.value.upper() not in ("0", "FALSE"):
        raise InputError(f"{alternative.where} is '{alternative.value}'; volid knows the standard model alone, 0")


ISG_VOLCOMP = IsgVolcomp()
