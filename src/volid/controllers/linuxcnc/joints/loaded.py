"""What LinuxCNC holds when it has loaded its INI file and the files of COMP_FILE: tables of error values of its joints."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from volid.compensation.tables.axis_table import AxisTable
from volid.controllers.base import text_of
from volid.controllers.linuxcnc.joints.comp_file import SHARE, errors_of, rows_of
from volid.controllers.linuxcnc.joints.ini import Stated, coordinates, joints_of, stated, units
from volid.controllers.linuxcnc.joints.prepared import scales
from volid.exceptions import InputError
from volid.model.machine import Machine


class Loading(NamedTuple):
    """The files but for the INI file, the machine, and what is stated of both."""

    files: Mapping[str, str | bytes]
    machine: Machine
    linear_units: str
    kind: int


def tables_of(files: Mapping[str, str | bytes], machine: Machine, options: Mapping[str, Any]) -> tuple[AxisTable, ...]:
    """Tables of the joints. With an INI file its joints, types and unit count; without one the name says the axis: x.comp."""
    inis = [stated(n, text_of(n, c)) for n, c in files.items() if n.lower().endswith(".ini")]
    if len(inis) > 1:
        raise InputError(f"{inis[1].name}: a second INI file beside {inis[0].name}; expected one")
    given = {n: c for n, c in files.items() if not n.lower().endswith(".ini")}
    loading = Loading(given, machine, options["units"], options["comp_file_type"])
    found = _of_ini(inis[0], loading, options["coordinates"]) if inis else ()
    if not found:
        found = [_of_file(n, c, _letter(n, machine), loading) for n, c in given.items()]
    if not found:
        raise InputError(
            f"{', '.join(files) or 'no file'}: neither COMP_FILE nor BACKLASH; give the files of the joints"
        )
    return _one_each(found)


def _one_each(tables: Sequence[AxisTable]) -> tuple[AxisTable, ...]:
    """One table per axis. Raises `InputError` where two joints of an axis have different ones."""
    found: dict[str, AxisTable] = {}
    for table in tables:
        other = found.setdefault(table.output, table)
        same = all(np.array_equal(getattr(table, k), getattr(other, k)) for k in ("positions", "forward", "reverse"))
        if not same:
            raise InputError(f"two different tables of axis {table.output}; volid holds one for all joints of an axis")
    return tuple(found.values())


def _letter(name: str, machine: Machine) -> str:
    """The axis that the name of a file says: x.comp, X_axis.comp."""
    stem = name.replace("\\", "/").rsplit("/", 1)[-1].rsplit(".", 1)[0].upper()
    if stem[:1] in machine.letters and not stem[1:2].isalpha():
        return stem[0]
    raise InputError(
        f"{name}: its name does not say which axis of {', '.join(machine.letters)} it is for; name it such as x.comp, or give "
        "the INI file as well"
    )


def _of_file(name: str, content: str | bytes, letter: str, loading: Loading) -> AxisTable:
    """The table of one file."""
    rows = rows_of(name, content)
    at, size = scales(loading.machine, letter, loading.linear_units)
    errors = errors_of(name, rows, loading.kind) / size
    return AxisTable(letter, letter, rows[:, 0] / at, errors[:, 0], errors[:, 1], source=name)


def _of_ini(ini: Stated, loading: Loading, order: str | None) -> list[AxisTable]:
    """Tables of the joints that an INI file names."""
    try:
        order = coordinates(ini.get("TRAJ", "COORDINATES") or order or "") if ini.get("TRAJ", "COORDINATES") else order
        loading = loading._replace(linear_units=units(ini.get("TRAJ", "LINEAR_UNITS") or loading.linear_units))
    except ValueError as error:
        raise InputError(f"{ini.name}, [TRAJ]: {error}") from None
    letters = {n: a for a, numbers in joints_of(loading.machine, order).items() for n in numbers}
    tables = [_of_joint(ini, joint, letters.get(joint), loading) for joint in ini.joints]
    named = {_last(ini.get(f"JOINT_{j}", "COMP_FILE") or "") for j in ini.joints}
    unused = [n for n in loading.files if _last(n) not in named]
    if unused and any(named):
        raise InputError(
            f"{unused[0]}: {ini.name} does not name it as COMP_FILE of a joint, so LinuxCNC does not load it"
        )
    return [t for t in tables if t is not None]


def _of_joint(ini: Stated, joint: int, letter: str | None, loading: Loading) -> AxisTable | None:
    """The table of a joint, from its file or from BACKLASH; None where it has neither."""
    section = f"JOINT_{joint}"
    named, backlash = ini.get(section, "COMP_FILE"), ini.number(section, "BACKLASH")
    if named is None and not backlash:
        return None
    if letter is None:
        raise InputError(f"{ini.name}, [{section}]: no axis of the machine has joint {joint}; state `coordinates`")
    if named is None:
        return _of_backlash(f"{ini.name}, [{section}] BACKLASH", backlash, letter, loading)
    given = {_last(n): (n, c) for n, c in loading.files.items()}
    if _last(named) not in given:
        raise InputError(
            f"{ini.name}, [{section}] COMP_FILE: {named} is not among the files; LinuxCNC does not start without it"
        )
    kind = ini.number(section, "COMP_FILE_TYPE")
    if kind not in (0, 1):
        raise InputError(f"{ini.name}, [{section}] COMP_FILE_TYPE: {kind:g}; expected 0 or 1")
    return _of_file(*given[_last(named)], letter, loading._replace(kind=int(kind)))


def _of_backlash(where: str, backlash: float, letter: str, loading: Loading) -> AxisTable:
    """The table of a joint without a file: motor = q ± BACKLASH / 2."""
    travel = np.array(loading.machine.axis(letter).travel)
    at, size = scales(loading.machine, letter, loading.linear_units)
    if abs(backlash) > SHARE * at * np.ptp(travel):
        raise InputError(
            f"{where}: {backlash:g}, on a travel of {at * np.ptp(travel):g}; expected the reversal of the axis"
        )
    half = np.full(2, 0.5 * backlash / size)
    return AxisTable(letter, letter, travel, -half, half, source="BACKLASH")


def _last(path: str) -> str:
    """The name of a file without its folders."""
    return path.replace("\\", "/").rsplit("/", 1)[-1]
