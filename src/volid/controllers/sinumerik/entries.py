"""Numbered tables of a SINUMERIK as assignments of $AN_CEC, and back."""

from __future__ import annotations

from collections.abc import Mapping

from volid.controllers.sinumerik.ini_files import Parts, Setting, axis_of, name_of, number
from volid.controllers.sinumerik.products import Entry
from volid.controllers.tables.equal_steps import Lattice
from volid.exceptions import InputError
from volid.model.machine import Machine

SUFFIXES = ("STEP", "MIN", "MAX", "INPUT_AXIS", "OUTPUT_AXIS", "DIRECTION", "MULT_BY_TABLE", "IS_MODULO")


def text_of_entry(e: Entry, names: Mapping[str, str]) -> str:
    """The assignments to one table."""
    t = e.index
    lines = [f"; table {t}: {e.source}"]
    lines += [f"$AN_CEC[{t},{n}]={number(v)}" for n, v in enumerate(e.values)]
    lines.append(f"$AN_CEC_INPUT_AXIS[{t}]=({name_of(e.argument, names)})")
    lines.append(f"$AN_CEC_OUTPUT_AXIS[{t}]=({name_of(e.output, names)})")
    ends = (("STEP", e.lattice.step), ("MIN", e.lattice.low), ("MAX", e.lattice.high))
    lines += [f"$AN_CEC_{suffix}[{t}]={number(value)}" for suffix, value in ends]
    by = 0 if e.times is None else e.times + 1
    whole = (("DIRECTION", e.direction), ("MULT_BY_TABLE", by), ("IS_MODULO", int(e.modulo)))
    return "\n".join([*lines, *(f"$AN_CEC_{suffix}[{t}]={value}" for suffix, value in whole)])


def take(s: Setting, found: dict[int, Parts]) -> None:
    """Puts one assignment of $AN_CEC into its table."""
    suffix = s.name.removeprefix("AN_CEC").lstrip("_")
    if suffix in ("INPUT_NCU", "OUTPUT_NCU"):
        return
    if suffix not in ("", *SUFFIXES) or len(s.index) != (1 if suffix else 2):
        raise InputError(
            f"{s.where}: ${s.name}[{','.join(s.index)}] is unknown; expected $AN_CEC[table,point], or one of "
            f"_{', _'.join(SUFFIXES)} [table]"
        )
    parts = found.setdefault(s.whole(0), Parts({}, {}))
    if suffix:
        parts.others[suffix] = s
    else:
        parts.points[s.whole(1)] = s


def entry_of(index: int, parts: Parts, machine: Machine, names: Mapping[str, str]) -> Entry:
    """The table that assignments make. Raises `InputError` that names file and line."""
    what = f"$AN_CEC table {index}"
    ends = (parts.of(suffix, what) for suffix in ("OUTPUT_AXIS", "INPUT_AXIS"))
    output, argument = (axis_of(s.value, s.where, names, machine) for s in ends)
    x, values = parts.curve(what)
    by = parts.choice("MULT_BY_TABLE", *range(63))
    lattice = Lattice(float(x[0]), float(x[-1]), len(x))
    modulo = parts.period(argument, x, what) > 0.0
    way = parts.choice("DIRECTION", 0, 1, -1)
    return Entry(index, output.letter, argument.letter, way, lattice, values, by - 1 if by else None, modulo)


def ask_factor(e: Entry, entries: Mapping[int, Entry]) -> None:
    """Raises `InputError` for a product that volid does not know: its factor is missing, direction-dependent or repeated."""
    by = entries.get(e.times if e.times is not None else -1)
    if by is None:
        raise InputError(
            f"$AN_CEC table {e.index} is multiplied by table number {(e.times or 0) + 1}, which the files do not have"
        )
    if by.direction or by.modulo:
        raise InputError(
            f"$AN_CEC table {e.index} is multiplied by table number {by.index + 1}, whose values depend on direction or repeat; "
            "volid reads products with tables of DIRECTION 0 and IS_MODULO 0"
        )
