"""`volid plan`: what to measure, as a campaign manifest whose CSV files lack the readings."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING, Any

from volid.cli.common import add_output, check_output, conclude, explain, print_json
from volid.cli.numbers import add_unusual, finite, number, place, seed, tool_vector
from volid.cli.progress import Progress
from volid.report.text import vector

if TYPE_CHECKING:
    from volid.campaign import Campaign
    from volid.model.machine import Machine

HELP = "what to measure: a standard path or grid as a manifest without readings"

GRID, CONE, STANDARD = "static-grid", "cone-frustum", "standard"
ISO = ("K1", "K2", "K4")
LAYOUTS = ("A", "B", "C")  # two rotary axes in the head, two in the table, one on each side
_TESTS_OF = {  # option: tests that know it ("K": the ISO ones) and their default in words
    "sphere": (GRID, "K"),
    "sensor_on": (GRID, "K"),
    "centre": (CONE,),
    "length": (CONE,),
    "half_angle": (CONE,),
    "inclination": (CONE,),
    "calibrated_u": (CONE,),
    "tool": (GRID, "K", CONE, STANDARD),
    "u": (GRID, "K", CONE, STANDARD),
    "seed": (STANDARD,),
}
_EPILOG = """\
TEST is one of
  static-grid            R-test at all pairs of positions of the rotary axes; --points N1,N2,
                         default 37,13, of the first rotary axis (workpiece to tool) and the second
  AK1 … CK4, K1, K2, K4  paths of ISO 10791-6 with the sphere in the nest, there and back; K1: the
                         second rotary axis turns, K2: the first, K4: both; A two rotary axes in the
                         head, B in the table, C one on each side; --points each way, default 73
  cone-frustum           ball bar at a cone frustum, all axes at once; --points, default 73
  standard               tracker distances from six stations for multilateration, three or more tool
                         vectors (--tool); --points per station, default 400
Spheres (workpiece frame, all axes at 0) and tool vectors that are not given are chosen so that the
travels allow them; several of one go with one or as many of the other. The linear axes follow.
Collisions are not considered. Beside PLAN.toml stand PLAN.machine.toml and the CSV files.

example:
  volid plan models/wCAYXbZt_trunnion.toml --test static-grid --points 37,13 -o plan.toml

exit status: 0 good; 1 written, but positions outside the travel were left out, which are named, or
tool vectors leave errors undetermined;
2 bad input
"""


def sphere(text: str) -> tuple[str, tuple[float, float, float]]:
    """ "P1=60,20,30" as a name and a place [mm], for argparse."""
    name, _, where = text.partition("=")
    try:
        if not name.strip() or not where:
            raise ValueError
        x, y, z = (finite(part) for part in where.split(","))
    except ValueError:
        raise argparse.ArgumentTypeError(
            f"'{text}' is no sphere; expected NAME=x,y,z in mm, such as P1=60,20,30"
        ) from None
    return name.strip(), (x, y, z)


def counts(text: str) -> tuple[int, ...]:
    """ "37,13" or "73" as numbers of positions, for argparse."""
    try:
        numbers = tuple(int(part) for part in text.split(","))
    except ValueError:
        numbers = ()
    if len(numbers) not in (1, 2) or min(numbers) < 2:
        raise argparse.ArgumentTypeError(f"'{text}' are no numbers of positions; expected N or N1,N2, each at least 2")
    return numbers


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    explain(parser, _EPILOG)
    parser.add_argument("machine", metavar="MACHINE", help="machine file (TOML)")
    parser.add_argument(
        "named", metavar="TEST", nargs="?", help="see below; default static-grid with rotary axes, standard without"
    )
    parser.add_argument("--test", metavar="TEST", help="the same as an option")
    parser.add_argument(
        "--sphere", metavar="NAME=x,y,z", type=sphere, action="append", help="place on the workpiece, mm; repeatable"
    )
    parser.add_argument(
        "--tool", metavar="x,y,z", type=tool_vector, action="append", help="tool vector, mm; repeatable"
    )
    parser.add_argument("--points", metavar="N[,N2]", type=counts, help="numbers of positions")
    parser.add_argument(
        "--u",
        metavar="U",
        type=number("mm", above=0.0),
        help="standard uncertainty of a reading, mm; default 0.0005; standard: 0.0003 and 3e-7 of the distance",
    )
    parser.add_argument(
        "--sensor-on", choices=("tool", "workpiece"), help="where the R-test's sensors sit; default tool"
    )
    parser.add_argument("--centre", metavar="x,y,z", type=place, help="of the cone frustum's circle, mm")
    parser.add_argument("--length", metavar="L", type=number("mm", above=0.0), help="of the ball bar, mm; default 100")
    parser.add_argument(
        "--calibrated-u", metavar="U", type=number("mm", above=0.0), help="of the bar's length, mm; default 0.0005"
    )
    parser.add_argument(
        "--half-angle",
        metavar="DEG",
        type=number("degrees", least=0.0, most=90.0),
        help="of the cone, degrees; default 15",
    )
    parser.add_argument(
        "--inclination",
        metavar="DEG",
        type=number("degrees", least=-180.0, most=180.0),
        help="of the cone's axis, degrees; default 10",
    )
    parser.add_argument("--seed", type=seed, metavar="N", help="of the positions of --test standard; default 0")
    add_unusual(parser)
    add_output(parser, "PLAN.toml", "manifest; CSV and machine file stand beside it", required=True)


def run(args: argparse.Namespace) -> int:
    """Plan and write; 1 when positions were left out. Raises `InputError`, `OutputError`."""
    from volid.exceptions import OutputError

    if not args.output.lower().endswith(".toml"):
        raise OutputError(f"{args.output}: a plan is a manifest; choose a name that ends in .toml, such as plan.toml")
    check_output(args.output, args.force, [args.machine])
    with Progress() as progress:
        progress("planning")
        from volid.io import read_machine, write_manifest

        machine = read_machine(args.machine)
        plan = _plan(machine, _test(machine, _named(args)), args)
        write_manifest(plan, args.output, overwrite=args.force)
    if args.json:
        print_json(_as_json(plan, args))
    else:
        print("\n".join([*_summary(plan), f"written: {args.output}"]))
    return conclude(args, plan.warnings)


def _named(args: argparse.Namespace) -> str | None:
    """TEST, from behind MACHINE or from --test. Raises `InputError` for two different ones."""
    from volid.exceptions import InputError

    if args.named and args.test and args.named != args.test:
        raise InputError(f"two tests are named, {args.named} and --test {args.test}; keep one")
    return args.named or args.test


def _test(machine: Machine, name: str | None) -> str:
    """The test's name in its one spelling. Raises `InputError` for one that does not exist."""
    from volid.exceptions import InputError

    if name is None:
        return STANDARD if all(axis.is_linear for axis in machine.axes) else GRID
    known = (GRID, CONE, STANDARD, *ISO, *(layout + test for layout in LAYOUTS for test in ISO))
    found = {test.casefold(): test for test in known}.get(name.casefold())
    if found is None:
        raise InputError(f"--test '{name}' is unknown; expected one of {', '.join(known)}")
    return found


def _plan(machine: Machine, test: str, args: argparse.Namespace) -> Campaign:
    """The plan of a test with the options that were given. Raises `InputError`."""
    from volid.exceptions import InputError
    from volid.planning import cone_frustum, iso10791_path
    from volid.planning.standard import standard_plan

    given, n = _given(test, args), args.points
    if test == GRID:
        return _static_grid(machine, given, n or (37, 13))
    if n is not None and len(n) == 2:
        raise InputError(f"--points {n[0]},{n[1]}: --test {test} takes one number")
    if n is not None:
        given["n_per_station" if test == STANDARD else "n"] = n[0]
    if test == STANDARD:
        if "tool" in given:
            given["tools"] = given.pop("tool")
        return standard_plan(machine, **given)
    if "tool" in given:
        given["tool"] = _only_one(args.tool, "--tool", test)
    if test == CONE:
        return cone_frustum(machine, **given)
    if "sphere" in given:
        given["sphere"] = _only_one(args.sphere, "--sphere", test)[1]
    return iso10791_path(machine, test, **given)


def _static_grid(machine: Machine, given: dict[str, Any], n: tuple[int, ...]) -> Campaign:
    """R-test at all pairs of n[0] and n[-1] positions. Raises `InputError` for two spheres of one name."""
    from volid.exceptions import InputError
    from volid.planning import rtest_static_grid

    named = given.pop("sphere", None)
    spheres = dict(named) if named else None
    if spheres is not None and len(spheres) < len(named):
        raise InputError("--sphere: two spheres have one name; give every sphere its own")
    return rtest_static_grid(machine, spheres, given.pop("tool", None), n[0], n[-1], **given)


def _given(test: str, args: argparse.Namespace) -> dict[str, Any]:
    """The options that were given. Raises `InputError` for one that the test does not know, or a length that is none."""
    from volid.exceptions import InputError

    kind = "K" if test[-2:] in ISO else test
    given = {name: getattr(args, name) for name in _TESTS_OF if getattr(args, name) is not None}
    for name in given:
        option = "--" + name.replace("_", "-")
        if kind not in _TESTS_OF[name]:
            fits = ", ".join(GRID if t == GRID else "K1 … K4" if t == "K" else t for t in _TESTS_OF[name])
            raise InputError(f"{option} is not for --test {test}, but for {fits}; leave it out")
        if name in ("u", "length", "calibrated_u") and not given[name] > 0.0:
            raise InputError(f"{option} {given[name]:g}: expected a number > 0 in mm")
    return given


def _only_one(values: list[Any], option: str, test: str) -> Any:
    from volid.exceptions import InputError

    if len(values) > 1:
        raise InputError(f"{option} stands {len(values)} times; --test {test} takes one")
    return values[0]


def _summary(plan: Campaign) -> list[str]:
    """What is to be measured, in a few lines."""
    from volid.observations import KINDS

    lines = [f"machine '{plan.machine.name}', {plan.machine.structure}"]
    for readings in plan.sets:
        lines.append(f"set '{readings.name}': {len(readings)} rows of kind {readings.kind}")
        kind = KINDS[readings.kind]
        lines += [f"{kind.standing} {n}: {vector(p)} mm" for n, p in kind.standing_at(readings).items()]
        tools = dict.fromkeys(map(tuple, readings.tool.tolist()))
        lines.append(f"tool vectors: {', '.join(vector(t) for t in tools)} mm")
    return [*lines, *(f"station {s.name}: {vector(s.position)} mm" for s in plan.stations if s.position is not None)]


def _as_json(plan: Campaign, args: argparse.Namespace) -> dict[str, Any]:
    from volid.observations import KINDS

    return {
        "output": args.output,
        "machine": plan.machine.name,
        "structure": plan.machine.structure,
        "title": plan.title,
        "sets": [
            {
                "set": s.name,
                "kind": s.kind,
                "rows": len(s),
                "spheres": dict(KINDS[s.kind].standing_at(s)),
                "tools": [list(t) for t in dict.fromkeys(map(tuple, s.tool.tolist()))],
            }
            for s in plan.sets
        ],
        "stations": {s.name: s.position for s in plan.stations},
        "warnings": list(plan.warnings),
    }
