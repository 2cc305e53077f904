"""What stands in the files of the volumetric compensation of the ISG kernel, and what is read from them."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from volid.compensation.grids.grid import AnyGrid, Grid
from volid.compensation.package import Compensation
from volid.compensation.tables.error_table import ErrorTable
from volid.controllers.isg.iso_convention import Convention, table_axes
from volid.controllers.isg.iso_parameters import grid_of, tables_of
from volid.controllers.isg.iso_texts import ARGUMENTS, Block, read_etalon, read_isg_csv
from volid.controllers.isg.kernel_lists import Entry, lines, needed
from volid.exceptions import InputError
from volid.model.iso230 import LINEAR_AXES, ROTARY_AXES, parse
from volid.model.machine import Machine

CSV, LIST = "vol.csv", "vol.lis"
FORMATS = {"ISG_CSV": read_isg_csv, "ETALON_EXCHANGE": read_etalon}
_CENTRE = re.compile(r"P[XYZ][ABC]")

# ------------------------------------------------------------------------------------------------ writing


def plain(text: str) -> str:
    return re.sub(r"[^\w .,()-]", "", text)


def ask_axes(machine: Machine) -> None:
    linear = {a.letter for a in machine.linear}
    if linear != set(LINEAR_AXES) or len(machine.axes) > 6:
        raise InputError(
            f"isg-volcomp: machine '{machine.name}' has the axes {', '.join(machine.letters)}; the control asks "
            f"for exactly X, Y, Z and "
            "at most three rotary axes"
        )


def grid_block(grid: AnyGrid) -> Block:
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


def grid_notes(grid: AnyGrid) -> tuple[str, ...]:
    if not np.nan_to_num(grid.values[:, 3:]).any():
        return ()
    tool = ", ".join(f"{v:g}" for v in grid.reference)
    turn = float(np.abs(np.nan_to_num(grid.values[:, 3:])).max())
    return (
        f"The grid holds for the tool vector ({tool}) mm alone, because the control adds no lever arm: 100 mm "
        f"of another tool are wrong "
        f"by up to {1e5 * turn:.2g} µm. Option form=tables has lever arms.",
    )


def tool_notes(tables: Sequence[ErrorTable], tool: np.ndarray) -> tuple[str, ...]:
    """How the tool stands in the file, where rotations act through it."""
    if not any(parse(t.function).is_rotation for t in tables):
        return ()
    vector = ", ".join(f"{v:g}" for v in tool)
    where = f"is the tool ({vector}) mm" if tool.any() else "is 0, so that the control must add its active tool"
    return (
        f"P0X, P0Y, P0Z {where}. Public sources do not say whether the control adds its active tool: make the one-point "
        "check of a rotation with two tools of different length, and take the other value of option tool where the longer "
        "one is wrong.",
    )


def kinematics(convention: Convention, tool: np.ndarray) -> dict[str, float]:
    """Where the tool and the centres of rotation stand, and lines of rotary axes other than X, Y, Z."""
    found = {f"P0{c}": float(v) for c, v in zip(LINEAR_AXES, tool, strict=True)}
    for axis in (a for a in convention.machine.axes if not a.is_linear):
        found |= {f"P{c}{axis.letter}": float(v) for c, v in zip(LINEAR_AXES, axis.point, strict=True)}
        if tuple(axis.unit_vector) != _own_line(axis.letter):
            found |= {f"V{c}{axis.letter}": float(v) for c, v in zip(LINEAR_AXES, axis.unit_vector, strict=True)}
    return found


def _own_line(letter: str) -> tuple[float, ...]:
    return tuple(float(letter == a) for a in ROTARY_AXES)


def list_text(machine: Machine, options: Mapping[str, Any], with_model: bool) -> str:
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


def named_files(lists: Sequence[str], stated: Mapping[str, Entry], texts: Mapping[str, str]) -> list[tuple[str, str]]:
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


def compensation_of(
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
