"""Joints of LinuxCNC: which number belongs to which axis letter, and what the INI file says of each joint.

With trivkins, joint n is the nth letter of `coordinates`, which `[TRAJ]COORDINATES` repeats; a letter that stands twice has two
joints, such as the two drives of a gantry. In an INI file only a line that begins with # or ; is a comment, and of a name that
stands twice in a section the first one counts.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass

from volid.controllers.linuxcnc.joints.comp_file import plain
from volid.exceptions import InputError
from volid.model.machine import Machine

LETTERS = "XYZABCUVW"
INCH = 25.4  # mm
MM, INCHES = "mm", "inch"
SHEET_IN_MM = (
    "positions and motions in the commissioning sheet are in mm: command them after G21; displays are in inches"
)
_SECTION, _LINE = re.compile(r"\s*\[([^\]]*)\]"), re.compile(r"\s*(\w+)\s*=\s*(.*?)\s*$")


def coordinates(text: str) -> str:
    """Letters of the joints in their order. Raises `ValueError` for anything else."""
    letters = "".join(text.split()).upper()
    if not letters or set(letters) - set(LETTERS):
        raise ValueError(f"expected letters of {LETTERS} in the order of the joints, such as XYZ")
    return letters


def units(text: str) -> str:
    """LINEAR_UNITS of the machine. Raises `ValueError` for a unit that LinuxCNC does not have."""
    if text.lower() not in (MM, "metric", "inch", "in", "imperial"):
        raise ValueError("expected mm or inch, as [TRAJ]LINEAR_UNITS says")
    return MM if text.lower() in (MM, "metric") else INCHES


def unit_of(machine: Machine, letter: str, linear_units: str) -> float:
    """What a value of an axis [mm or °] is divided by for the machine unit."""
    return INCH if machine.axis(letter).is_linear and linear_units == INCHES else 1.0


def joints_of(machine: Machine, stated: str | None) -> dict[str, tuple[int, ...]]:
    """Numbers of the joints by axis letter; by default the machine's letters in LinuxCNC's order.

    Raises `InputError` where an axis of the machine has no joint.
    """
    order = "".join(sorted(machine.letters, key=LETTERS.index)) if stated is None else stated
    missing = [a for a in machine.letters if a not in order]
    if missing:
        raise InputError(f"`coordinates={order}`: the machine's axis {missing[0]} has no joint; name all its axes")
    return {a: tuple(n for n, letter in enumerate(order) if letter == a) for a in machine.letters}


@dataclass(frozen=True)
class Stated:
    """What an INI file says: values by section and name, the first of each, and its own name."""

    name: str
    values: Mapping[str, Mapping[str, str]]

    def get(self, section: str, key: str) -> str | None:
        """A value, or None."""
        return self.values.get(section, {}).get(key)

    def number(self, section: str, key: str) -> float:
        """A number, 0 where there is none. Raises `InputError` for anything else."""
        text = self.get(section, key) or "0"
        value = plain(text)
        if value is None:
            raise InputError(f"{self.name}, [{section}] {key}: '{text}'; expected a number with a decimal point")
        return value

    @property
    def joints(self) -> list[int]:
        """Numbers of the joints that have a section."""
        return sorted(int(s[6:]) for s in self.values if re.fullmatch(r"JOINT_\d{1,2}", s))


def stated(name: str, text: str) -> Stated:
    """The values of an INI file."""
    found: dict[str, dict[str, str]] = {}
    section: dict[str, str] = {}
    for line in text.splitlines():
        if line.lstrip()[:1] in ("#", ";"):
            continue
        head, pair = _SECTION.match(line), _LINE.match(line)
        if head:
            section = found.setdefault(head[1].strip(), {})
        elif pair:
            section.setdefault(pair[1], pair[2])
    return Stated(name, found)


def states_compensation(text: str) -> bool:
    """Whether an INI file names a COMP_FILE or a BACKLASH of a joint."""
    ini = stated("", text)
    return any(ini.get(f"JOINT_{n}", key) for n in ini.joints for key in ("COMP_FILE", "BACKLASH"))
