"""Machines for tests: layouts that people own as exact chains, and as machines of the package, by way of the machine file."""

from __future__ import annotations

from exact_chain import ExactMachine, machine_toml

from volid.io.machines import parse_machine
from volid.model.machine import Machine

# three linear axes, as in models/: cross-table vertical, gantry of 3 m, horizontal with Z table
VERTICAL = ExactMachine("w X' Y' b Z (C) t", {"X": (0, 760), "Y": (0, 430), "Z": (-460, 0)})
GANTRY = ExactMachine("w b X Y Z (C) t", {"X": (0, 3000), "Y": (0, 2000), "Z": (-1000, 0)})
HORIZONTAL = ExactMachine("w Z' b X Y (C) t", {"X": (0, 800), "Y": (0, 700), "Z": (0, 750)})
MACHINES = {"vertical": VERTICAL, "gantry": GANTRY, "horizontal": HORIZONTAL}

# five axes
LINEAR = {"X": (-400.0, 400.0), "Y": (-350.0, 350.0), "Z": (-200.0, 500.0)}
TILTING = (-100.0, 100.0)
POINTS = {"A": (12.0, -7.0, -50.0), "B": (-9.0, 5.0, -40.0), "C": (4.0, -6.0, 3.0)}
STRUCTURES = {
    "tilting table C'A'": "w C' A' Y' X' b Z t",
    "tilting table C'B'": "w C' B' X' b Y Z t",
    "table and head": "w C' Y' b X Z B t",
    "fork head CA": "w Y' b X Z C A t",
    "fork head CB": "w b X Y Z C B t",
    "mill-turn": "w C' b Z X Y B t",
}
# B at 45° between Y and Z, its components in its own frame, as in models/
NUTATING = {"nutating head": "w C' b X Y Z B t", "nutating table": "w C' B' Y' b X Z t"}
THREE_ROTARY = "w C' Y' b X Z B A t"
ROTARY_TABLE = "w C' Y' X' b Z t"
# every way to share three linear and one or two rotary axes among table and head
LAYOUTS = {
    "table C on A": STRUCTURES["tilting table C'A'"],
    "table C on B": STRUCTURES["tilting table C'B'"],
    "split C and B": "w C' b X Y Z B t",
    "fork C A": "w b X Y Z C A t",
    "fork C B": STRUCTURES["fork head CB"],
    "rotary table": "w B' X' b Y Z t",
}
LINEAR_OFF = '"E?[XYZ]" = false\n"E?0[XYZ]" = false'


def exact_machine(structure: str) -> ExactMachine:
    """Exact machine of a structural code, rotary axes off the origin and off one another; B inclined for `NUTATING`."""
    letters = [c for c in structure if c in "XYZABC"]
    travel = {a: LINEAR.get(a, (-180.0, 180.0) if a == "C" else TILTING) for a in letters}
    points = {a: POINTS[a] for a in letters if a in POINTS}
    if structure in NUTATING.values():
        return ExactMachine(structure, travel, point=points, direction={"B": (0.0, 1.0, 1.0)}, axis_frame="B")
    return ExactMachine(structure, travel, point=points)


def exact_of(machine: Machine) -> ExactMachine:
    """The same chain in plain matrices, from the numbers of the file."""
    rotary = [a for a in machine.axes if not a.is_linear]
    return ExactMachine(
        machine.structure,
        {a.letter: a.travel for a in machine.axes},
        point={a.letter: a.point for a in rotary},
        direction={a.letter: a.direction for a in rotary},
        axis_frame=[a.letter for a in rotary if a.axis_frame],
    )


def volid_machine(exact: ExactMachine, extra: str = "") -> Machine:
    """The package's machine; `extra`: further tables of the machine file, such as [model]."""
    return parse_machine(machine_toml(exact, extra=extra), "machine.toml")


def fixed(segments: int, more: str = "") -> str:
    """[model] with a fixed resolution: for tests that are not about its choice, and much faster."""
    return f"[model]\nsegments = {segments}\n{more}"


def resolved(exact: ExactMachine, functions: str = "", segments: int = 12) -> Machine:
    """The package's machine with a fixed resolution; `functions`: lines of [model.functions]."""
    return volid_machine(exact, fixed(segments, f"[model.functions]\n{functions}"))
