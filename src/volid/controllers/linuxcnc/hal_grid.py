"""LinuxCNC: volumetric compensation by a grid over X, Y, Z in HAL, with the component of `examples/linuxcnc`.

Two kinds of files: one grid for each type, in the format of `hal.text`, which the component volid_grid reads and interpolates
linearly in each direction at the commanded positions of the joints; and volid_grid.hal, which puts it between the motor commands
and the drives, and takes the corrections out of the feedback again. The corrections hold for the tool vector of the grid: nothing
adds a lever arm for another one.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from volid.compensation.grids.grid import Grid
from volid.compensation.package import Compensation
from volid.compensation.types import GRID
from volid.controllers.base import (
    COMPENSATION,
    DOCUMENTED,
    FREE,
    HELD,
    INFERRED,
    NO_REVERSAL,
    OPEN,
    RUN,
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
from volid.controllers.linuxcnc.hal.text import FORMAT, MOST, TYPES, UNITS, HalGrid, read_grid, write_grid
from volid.controllers.linuxcnc.hal.values import corrections_of, for_tool, grid_of, nodes_of, steepest
from volid.controllers.linuxcnc.hal.wiring import wiring
from volid.controllers.linuxcnc.joints.ini import INCHES, SHEET_IN_MM
from volid.controllers.turning import refuse_turning
from volid.exceptions import InputError
from volid.model.iso230 import LINEAR_AXES
from volid.model.machine import Machine

NAME = "linuxcnc-hal"
LONGER = 10.0  # mm of tool, for which the effect of the lever arm is stated
_RUN = "LinuxCNC 2.9 (Debian 12), simulator, examples/linuxcnc/volid_grid.comp"


def _unit(text: str) -> str:
    if text not in UNITS:
        raise ValueError("expected mm or inch, LINEAR_UNITS of the INI file")
    return text


def _coordinates(text: str) -> str:
    letters = text.replace(" ", "").upper()
    if not letters or set(letters) - set("XYZABCUVW") or len(set(letters)) != len(letters):
        raise ValueError(
            "expected the letter of each joint in the order of their numbers, such as XYZ, each once; of two joints that move "
            "one axis, name neither here and add the pin d-x, d-y or d-z to the commands of both with sum2"
        )
    return letters


DECLARATION = Declaration(
    name=NAME,
    title="LinuxCNC, grid of corrections in HAL",
    carries=dict.fromkeys(TYPES, GRID),
    nearest="a grid in HAL moves X, Y, Z by their own positions at one tool vector, and turns no rotary axis; for the angle of a "
    "rotary axis itself take linuxcnc with R-POS, else L-VOL here at one position of the rotary axes",
    sign=COMPENSATION,
    units="machine units, mm or inch, positions and values",
    reversal=NO_REVERSAL,
    outside=HELD,
    spacing=FREE,
    limits=f"at most {MOST:,} nodes",
    zero="nowhere: corrections are put on within the fade time once all joints are homed, and taken off so too",
    switching="one instance of the component per type, each with a pin: setp volid-l-vol.enable 0 switches L-VOL off, 1 on",
    options=(
        Option(
            "coordinates",
            "axis letter of each joint by number, as for trivkins; else those of the machine in the order XYZABC",
            None,
            _coordinates,
        ),
        Option("units", "mm or inch: LINEAR_UNITS of the INI file", "mm", _unit),
    ),
    commissioning=Commissioning(
        backup=("Copy the INI file and all files that HALFILE names.",),
        load=(
            "Build and install the component once: halcompile -i volid_grid.comp (examples/linuxcnc of volid).",
            "Copy the .grid files and volid_grid.hal beside the INI file, and put the line 'source volid_grid.hal' into the HAL "
            "file straight after 'addf motion-controller servo-thread'.",
            "For each joint of X, Y, Z, connect the command pin of the drive with the signal volid-x-motor in place of "
            "joint.0.motor-pos-cmd, and its feedback pin with the signal volid-x-drive in place of joint.0.motor-pos-fb.",
        ),
        activate=(
            "Start LinuxCNC and home all joints: the corrections are put on within the fade time (pin weight goes to 1).",
            "Compare the pins d-x, d-y, d-z at a few positions with the values of the grid before anything moves fast.",
        ),
        remove=(
            "setp volid-l-vol.enable 0 for the moment (the name as in volid_grid.hal); for good, take out the line "
            "'source volid_grid.hal' and connect the drives as before.",
        ),
    ),
    facts=(
        Fact("the drive moves to q + value, linear in each direction between the nodes, in every servo period", RUN, _RUN),
        Fact("beyond the nodes the value of the last one is held", RUN, _RUN),
        Fact("positions are looked up by joint.N.pos-cmd, which has no home offset and no COMP_FILE correction in it", DOCUMENTED,
             "LinuxCNC, manual page motion(9), joint.N.pos-cmd and joint.N.motor-pos-cmd"),
        Fact("LinuxCNC does not see the correction: positions shown and the following error stay as without it", RUN, _RUN),
        Fact("a damaged grid file stops the start of LinuxCNC, with the reason and the line", RUN, _RUN),
        Fact("eoffset of LinuxCNC could carry the same values, but takes a part of speed and acceleration and shows them", RUN,
             "LinuxCNC 2.9, simulator, axis.L.eoffset-counts"),
        Fact("COMP_FILE and BACKLASH add to the grid; do not give both the same positioning errors", INFERRED,
             "LinuxCNC, motor-pos-cmd contains them, pos-cmd does not"),
        Fact("homing a joint again by an index pulse, while the corrections are still being taken off, was not tried", OPEN),
    ),
)  # fmt: skip


class LinuxCNCHal(Controller):
    """Grids for the component volid_grid, and their wiring."""

    declaration = DECLARATION

    def of_these_files(self, options: Mapping[str, Any]) -> Mapping[str, str]:
        """The machine unit."""
        return {"units": f"{options['units']}, positions and values"}

    def write(self, job: Job) -> Written:
        """One .grid file per type, and volid_grid.hal. Raises `InputError` for what is no grid over X, Y, Z."""
        grids = _grids(job)
        unit, files = job.options["units"], []
        names = {label: f"{label.lower().replace('-', '_')}.grid" for label in _labels(grids)}
        for grid, name in zip(grids, names.values(), strict=True):
            held = HalGrid(grid.type, grid.tool, unit, nodes_of(grid), corrections_of(grid))
            text = write_grid(held, _comments(job, grid))
            files.append(ControlFile(name, text, f"corrections of {grid.type} at {len(grid.values)} nodes"))
        letters = job.options["coordinates"] or "".join(a for a in "XYZABC" if a in job.machine.letters)
        _ask_joints(letters, grids[0])
        hal = wiring(names, {a: letters.index(a) for a in grids[0].axes})
        files.append(ControlFile("volid_grid.hal", hal, "wiring of the component"))
        return Written(tuple(files), _parameters(grids, letters), _notes(job, grids), 0.5e-9 * UNITS[unit])

    def read(self, files: Mapping[str, str | bytes], machine: Machine, options: Mapping[str, Any]) -> Compensation:
        """The grids of all files, without those of HAL; rotations are 0, because no lever arm is added."""
        found = {n: c for n, c in files.items() if not n.endswith(".hal")}
        if not found:
            raise InputError(
                f"{NAME}: no grid among {', '.join(files) or 'no files'}; expected files that begin with {FORMAT} 1"
            )
        grids = tuple(grid_of(n, read_grid(n, text_of(n, c)), machine) for n, c in found.items())
        return Compensation(tuple(g.type for g in grids), (), grids)

    def recognises(self, name: str, content: str | bytes) -> bool:
        """Whether it begins as a grid for HAL."""
        return text_of(name, content[:200]).lstrip().startswith(f"{FORMAT} ")


def _labels(grids: Sequence[Grid]) -> list[str]:
    """The types, each once: L-VOL, and L-VOL-2 for a second grid of it."""
    kinds = [g.type for g in grids]
    before = [kinds[:i].count(k) for i, k in enumerate(kinds)]
    return [k if not n else f"{k}-{n + 1}" for k, n in zip(kinds, before, strict=True)]


def _grids(job: Job) -> tuple[Grid, ...]:
    """The grids of a job over linear axes. Raises `InputError` for anything else."""
    made = job.compensation
    grids = tuple(g for g in made.grids if isinstance(g, Grid))
    others = [*(t.function for t in made.tables), *(f"{t.output} by {t.argument}" for t in made.axis_tables)]
    others += [f"the {g.type} grid over {', '.join(g.axes)}" for g in made.grids if not isinstance(g, Grid)]
    if others or not grids:
        raise InputError(f"{NAME}: {', '.join(others) or 'nothing'}: no grid over X, Y, Z; {DECLARATION.nearest}")
    refuse_turning(NAME, job.machine)
    for grid in grids:
        if len(grid.values) > MOST:
            raise InputError(
                f"{NAME}: {grid.type} has {len(grid.values)} nodes; the component holds {MOST}. Take a larger `step`"
            )
    return tuple(for_tool(g, job) for g in grids)


def _comments(job: Job, grid: Grid) -> tuple[str, ...]:
    size = " × ".join(str(len(n)) for n in grid.nodes)
    return (
        f"corrections of {job.machine.name}, {size} nodes over {', '.join(grid.axes)}, written by volid for {NAME}",
        "they are added to the commands of the joints; they hold for this tool vector",
    )


def _ask_joints(letters: str, grid: Grid) -> None:
    missing = [a for a in grid.axes if a not in letters]
    if missing:
        raise InputError(
            f"{NAME}: option coordinates is '{letters}' and has no {', '.join(missing)}; the grid moves {', '.join(grid.axes)}"
        )


def _parameters(grids: tuple[Grid, ...], letters: str) -> tuple[tuple[str, str, str], ...]:
    """What the limits of the joints need beyond those of motion without corrections."""
    found = []
    for k, letter in enumerate(LINEAR_AXES):
        if letter not in grids[0].axes:
            continue
        most = sum(float(np.abs(g.values[:, k]).max()) for g in grids)
        slope = sum(steepest(g, k) for g in grids)
        joint = f"[JOINT_{letters.index(letter)}]"
        found.append(
            (
                f"{joint} travel of the drive",
                f"limits ± {most:.4f} mm",
                f"{letter} moves by up to {1e3 * most:.1f} µm more",
            )
        )
        found.append((f"{joint} STEPGEN_MAXVEL or that of the drive", f"MAX_VELOCITY × {1.0 + slope:.6f}",
                      "where all axes move at the same speed; leave as much for the acceleration"))  # fmt: skip
    return tuple(found)


def _notes(job: Job, grids: tuple[Grid, ...]) -> tuple[str, ...]:
    notes = [SHEET_IN_MM] if job.options["units"] == INCHES else []
    for grid in grids:
        tool = ", ".join(f"{v:g}" for v in grid.tool)
        turn = np.linalg.norm(grid.values[:, 3:], axis=1).max()
        off = "by what the data do not determine" if np.isnan(turn) else f"by up to {1e3 * LONGER * turn:.2f} µm"
        notes.append(f"{grid.type} holds for the tool vector ({tool}) mm; one longer by {LONGER:g} mm is off {off}")
        short = [a for a, n in zip(grid.axes, grid.nodes, strict=True)
                 if n[0] > job.machine.axis(a).travel[0] or n[-1] < job.machine.axis(a).travel[1]]  # fmt: skip
        if short:
            notes.append(
                f"{grid.type} does not reach over the travel of {', '.join(short)}; the last values are held there"
            )
    if any(not a.is_linear for a in job.machine.axes):
        notes.append("errors of the rotary axes are not in the grid; it holds for the rotated tool vector stated")
    return tuple(notes)


LINUXCNC_HAL = LinuxCNCHal()
