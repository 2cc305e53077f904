"""`volid apply`: a program of G-code with the compensation in its coordinates, for controls without tables."""

from __future__ import annotations

import argparse
import re
from collections.abc import Sequence
from typing import TYPE_CHECKING

from volid.cli.common import add_output, check_figure, check_output, conclude, explain, print_json, tell, write_figure
from volid.cli.control_options import add_files_of
from volid.cli.left_over import left_out
from volid.cli.numbers import count, finite, number, tool_vector, vector
from volid.cli.progress import Progress

if TYPE_CHECKING:
    from volid.compensation.control import Control
    from volid.controllers.existing.reading import ExistingCompensation
    from volid.controllers.programs.program import CorrectedProgram
    from volid.controllers.programs.setting import ProgramSetting

HELP = "a program of G-code corrected in advance, for controls that hold no table, such as grbl"

_EPILOG = """\
X, Y and Z of every motion go to where a control with the grid or tables would send the axes. Lines are cut
where the correction bends, arcs become lines. Coordinates are RS274/NGC, as LinuxCNC and grbl read them.
What is not followed from the text alone is refused with its line: canned cycles, cutter compensation,
subprograms, variables, probing, rotary axes, moved origins. Offsets and tools are those of the control:

  --offset G54=400,200,-300   machine position of the origin of G54, mm, for every offset that is used
  --tool 0,0,-150             tool vector, mm; for one tool of several: --tool T3=0,0,-120
  --length H1=150             length that G43 H1 takes, mm; without --tool the tool vector is 0,0,-150 then
  --touched                   an origin that was touched on the machine as it is lies beside the position shown

The control itself must not apply the same compensation. Not modelled: how it rounds corners (G64), its dynamics.

example:
  volid grid solution.h5 --type L-VOL --step 50 -o grid.csv
  volid apply grid.csv part.nc --offset G54=400,200,-300 --tool 0,0,-150 -o part_corrected.nc

exit status: 0 good; 1 written, but a point lies outside the grid, where its end values are held, files correct
something twice, or a grid without rotations is for another tool vector; 2 bad input, also a program with
something that is not followed: then nothing is written
"""
_NUMBERED_TOOL = re.compile(r"T(\d+)=(.*)")
_NUMBERED_LENGTH = re.compile(r"[HT]?(\d+)=(.*)")
_OFFSET = re.compile(r"(G5[4-9](?:\.[123])?)=(.*)")
_origin = vector("origin", "G54=400,200,-300")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    explain(parser, _EPILOG)
    parser.add_argument(
        "grid", metavar="GRID", help="a grid or table of volid, files of a control, or a folder of them"
    )
    parser.add_argument("program", metavar="PROGRAM.nc", help="the program")
    add_files_of(parser, of="GRID")
    parser.add_argument("--machine", metavar="MACHINE.toml", help="needed for tables of error functions alone")
    parser.add_argument(
        "--offset", metavar="G54=x,y,z", type=_offset, action="append", default=[], help="work offset, mm; repeat it"
    )
    parser.add_argument(
        "--tool", metavar="x,y,z|T1=x,y,z", type=_tool, action="append", default=[], help="tool vector, mm; repeat it"
    )
    parser.add_argument(
        "--length", metavar="H1=L", type=_length, action="append", default=[], help="tool length, mm; repeat it"
    )
    parser.add_argument("--units", choices=("mm", "inch"), help="where the program moves before G20 or G21")
    parser.add_argument(
        "--start", metavar="x,y,z", type=vector("place", "0,0,0"), help="machine position before the program, mm"
    )
    _add_rules(parser)
    parser.add_argument("--figure", metavar="FILE", help="the path and its corrections, .png, .svg or .pdf")
    parser.add_argument("--lang", choices=("en", "de"), default="en", help="language of the figure")
    add_output(parser, "OUT.nc", "the corrected program", required=True)


def _add_rules(parser: argparse.ArgumentParser) -> None:
    """How closely it is followed, and what is done with what is not certain."""
    parser.add_argument(
        "--chord",
        metavar="D",
        type=number("mm", above=0.0),
        default=0.001,
        help="largest distance from the corrected path, mm; default 0.001",
    )
    parser.add_argument("--digits", metavar="N", type=count(0, 9), default=4, help="decimals in mm; default 4")
    parser.add_argument("--block-delete", choices=("skip", "run"), help="what the control does with blocks with /")
    parser.add_argument("--passing", metavar="M,M", type=_codes, default=(), help="further M codes that move no axis")
    parser.add_argument(
        "--touched",
        action="store_true",
        help="the origins were touched on this machine, uncompensated: corrections count from that at the origin",
    )
    parser.add_argument("--straight-rapids", action="store_true", help="cut rapids as well; else their ends count")
    parser.add_argument(
        "--allow-beyond", action="store_true", help="points outside the grid are no reason for status 1"
    )


def run(args: argparse.Namespace) -> int:
    """Read, correct, write; 1 where a point lies outside the grid. Raises `InputError`, `OutputError`."""
    check_output(args.output, args.force, [args.grid, args.program])
    check_output(args.figure, args.force, [args.grid, args.program])
    check_figure(args.figure)
    with Progress() as progress:
        progress("reading")
        from volid.controllers.programs.program import apply_to_program
        from volid.io.programs import read_program, save_program

        (control, held), program, setting = _control(args), read_program(args.program), _setting(args)
        made = apply_to_program(
            control,
            program.text,
            setting,
            name=args.program,
            header=_header(args, held, control.active, setting),
            progress=progress,
        )
        progress("writing")
        save_program(made.text, args.output, program, overwrite=args.force)
        if args.figure:
            progress("drawing")
            _draw(made, args)
    _say(made, args)
    tell(args, left_out([args.grid], held))
    odd = [*control.corrected_twice, *_for_another_tool(control, setting)]
    return conclude(args, [*odd, *([] if args.allow_beyond else _beyond(made))])


def _say(made: CorrectedProgram, args: argparse.Namespace) -> None:
    from volid.report.text.program import program_data, program_text

    if args.json:
        print_json(program_data(made))
        return
    print("\n".join(program_text(made)))
    if args.allow_beyond:
        tell(args, _beyond(made))


def _beyond(made: CorrectedProgram) -> list[str]:
    """That points lie outside the grid, where they do."""
    from volid.report.text.program import line_words

    outside = made.counted.outside
    return [f"{line_words(outside)}: outside the nodes, where the end values are held"] if outside else []


def _for_another_tool(control: Control, setting: ProgramSetting) -> list[str]:
    """That a grid has no rotations by which it could be taken to the tool vectors of the program, where these are others."""
    import numpy as np

    from volid.compensation.active import vector_words
    from volid.compensation.types import TYPES

    tools = [t for t in (setting.tool, *setting.tools.values()) if t is not None]
    found = []
    for g in control.grids:
        types = [TYPES[n] for n in re.split(r" \+ | on top of ", g.type) if n in TYPES]
        fixed = (
            any("angular" in t.effects for t in types)
            and not np.nan_to_num(g.values[:, 3:]).any()
            and np.any(g.reference)
        )
        others = [t for t in tools if fixed and not np.allclose(t, g.reference)]
        if others:
            found.append(
                f"{g.type}: the grid has no rotations and holds for the tool vector {vector_words(g.reference)} alone; the "
                f"program was corrected by it with {vector_words(others[0])}"
            )
    return found


def _control(args: argparse.Namespace) -> tuple[Control, tuple[ExistingCompensation, ...]]:
    """The compensation, on the machine that is named or on plain axes, and the files that it is from."""
    from volid.controllers.programs.program import plain_machine
    from volid.exceptions import InputError
    from volid.io.compensations import control_of
    from volid.io.control_files import existing_of
    from volid.io.machines import read_machine

    machine = plain_machine() if args.machine is None else read_machine(args.machine)
    held = existing_of(machine, [args.grid], args.cnc, sign=args.sign, options=dict(args.option))
    control = control_of(machine, held)
    if not (control.tables or control.grids or control.axis_tables):
        raise InputError(f"{args.grid}: holds no table or grid (*.csv, *.h5); expected at least one")
    if control.tables and args.machine is None:
        raise InputError(
            f"{args.grid}: holds the table of {control.tables[0].function}, which acts through the chain; state `machine`"
        )
    return control, held


def _setting(args: argparse.Namespace) -> ProgramSetting:
    from volid.controllers.programs.setting import ProgramSetting

    tools = dict(args.tool)
    return ProgramSetting(
        offsets=dict(args.offset),
        tool=tools.pop(None, None),
        tools=tools,
        lengths=dict(args.length),
        units=args.units,
        start=args.start,
        chord=args.chord,
        digits=args.digits,
        block_delete=args.block_delete,
        passing=args.passing,
        straight_rapids=args.straight_rapids,
        touched=args.touched,
    )


def _header(
    args: argparse.Namespace, held: Sequence[ExistingCompensation], active: Sequence[str], setting: ProgramSetting
) -> list[str]:
    """What was done with what, for the first lines of the program."""
    from pathlib import Path

    from volid.cli.environment import version
    from volid.compensation.active import vector_words
    from volid.io.basics.provenance import sha256

    tools = {"all": setting.tool} if setting.tool else {}
    tools |= {f"T{n}": v for n, v in setting.tools.items()}
    words = [f"volid {version()} apply, chord {setting.chord:g} mm, original {Path(args.program).name}"]
    words += [f"sha256 {sha256(args.program)[:32]}", f"compensation {Path(args.grid).name}"]
    files = sorted(Path(name) for e in held for name in e.files)
    words += [f"{'sha256' if len(files) == 1 else f.name} {sha256(f)[:32]}" for f in files]
    words += [text[:200] for text in active]
    words += [f"offset {name} {vector_words(v)}" for name, v in setting.offsets.items()]
    words += ["corrections count from those at the origins, which were touched"] if setting.touched else []
    words += [f"tool {name} {vector_words(v)}" for name, v in tools.items()]
    return words + [f"length {n} {v:g} mm" for n, v in setting.lengths.items()]


def _draw(made: CorrectedProgram, args: argparse.Namespace) -> None:
    from volid.report.language import Texts
    from volid.report.plot.program import program_figure

    write_figure(program_figure(made, args.program, texts=Texts(args.lang)), args.figure, args.force)


def _offset(text: str) -> tuple[str, tuple[float, float, float]]:
    match = _OFFSET.fullmatch(text.upper().replace(" ", ""))
    if match is None:
        raise argparse.ArgumentTypeError(f"'{text[:40]}' is no work offset; expected such as G54=400,200,-300")
    return match[1], _origin(match[2])


def _tool(text: str) -> tuple[int | None, tuple[float, float, float]]:
    match = _NUMBERED_TOOL.fullmatch(text.upper())
    return (None, tool_vector(text)) if match is None else (int(match[1]), tool_vector(match[2]))


def _length(text: str) -> tuple[int, float]:
    match = _NUMBERED_LENGTH.fullmatch(text.upper())
    try:
        return int(match[1]), finite(match[2])  # type: ignore[index]
    except (TypeError, ValueError):
        raise argparse.ArgumentTypeError(f"'{text[:40]}' is no tool length; expected such as H1=150, in mm") from None


def _codes(text: str) -> tuple[float, ...]:
    try:
        return tuple(finite(part.strip().upper().removeprefix("M")) for part in text.split(","))
    except ValueError:
        raise argparse.ArgumentTypeError(f"'{text[:40]}' are no M codes; expected such as M100,M101") from None
