"""`volid plan`: what to measure, as a campaign manifest whose CSV files lack the readings."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING, Any

from volid.cli.common import add_output, check_output, conclude, explain, print_json
from volid.cli.numbers import add_unusual, count, finite, number, place, seed, tool_vector
from volid.cli.progress import Progress
from volid.report.text.basics import vector

if TYPE_CHECKING:
    from volid.campaign import Campaign
    from volid.model.machine import Machine

HELP = "what to measure: a standard path or grid as a manifest without readings"

_EPILOG = """\
TEST is one of
{plans}
Spheres (workpiece frame, all axes at 0) and tool vectors that are not given are chosen so that the
travels allow them; several of one go with one or as many of the other. The linear axes follow.
Collisions are not considered. Beside PLAN.toml stand PLAN.machine.toml and the CSV files.

example:
  volid plan models/wCAYXbZt_trunnion.toml --test static-grid --points 37,13 -o plan.toml
  volid plan --validate solution.h5 -o check.toml

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


def planes(text: str) -> tuple[str, ...]:
    """ "XY,ZX" as planes, for argparse."""
    return tuple(part.strip().upper() for part in text.split(","))


def length_u(text: str) -> float:
    """A standard uncertainty of a length, or "inf" where the length is unknown, for argparse."""
    return float("inf") if text.strip().lower() == "inf" else number("mm", least=0.0)(text)


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
    from volid.cli.plan_tests import plans_in_words

    explain(parser, _EPILOG.format(plans=plans_in_words()))
    parser.add_argument(
        "machine", metavar="MACHINE", nargs="?", help="machine file (TOML); not needed where a solution is given"
    )
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
    parser.add_argument("--runs", metavar="N", type=count(1, 100), help="how often lines are measured there and back")
    _add_lengths(parser)
    _add_angles(parser)
    parser.add_argument("--sensor-on", choices=("tool", "workpiece"), help="where the R-test's sensors sit")
    parser.add_argument("--centre", metavar="x,y,z", type=place, help="of a circle, mm")
    parser.add_argument("--planes", metavar="XY,…", type=planes, help="planes of circles")
    parser.add_argument("--vertical", choices=("X", "Y", "Z"), help="of direct measurement: the axis that is vertical")
    parser.add_argument("--seed", type=seed, metavar="N", help="of the positions")
    parser.add_argument(
        "--solution",
        "--validate",
        metavar="SOLUTION.h5",
        help="the solution that the plan is to test: the test validate",
    )
    add_unusual(parser)
    add_output(parser, "PLAN.toml", "manifest; CSV and machine file stand beside it", required=True)


def _add_lengths(parser: argparse.ArgumentParser) -> None:
    """Lengths and their uncertainties."""
    parser.add_argument(
        "--u",
        metavar="U",
        type=number("mm", above=0.0),
        help="standard uncertainty of a reading, mm",
    )
    parser.add_argument("--length", metavar="L", type=number("mm", above=0.0), help="of the ball bar or the gauge, mm")
    parser.add_argument("--calibrated-u", metavar="U", type=length_u, help="of the calibrated length, mm")
    parser.add_argument("--scale-u", metavar="U", type=number(least=0.0), help="of the gauge's scale, a ratio")
    parser.add_argument(
        "--form-u",
        metavar="U",
        type=number("mm", least=0.0),
        help="of straightedges and squares in direct measurement, mm; 0: straight; default 0.0005",
    )


def _add_angles(parser: argparse.ArgumentParser) -> None:
    """Angles of arcs and cones."""
    parser.add_argument(
        "--arc", metavar="DEG", type=number("degrees", above=0.0, most=360.0), help="angle of an arc, degrees"
    )
    parser.add_argument(
        "--half-angle",
        metavar="DEG",
        type=number("degrees", least=0.0, most=90.0),
        help="of the cone, degrees",
    )
    parser.add_argument(
        "--inclination",
        metavar="DEG",
        type=number("degrees", least=-180.0, most=180.0),
        help="of the cone's axis, degrees",
    )


def run(args: argparse.Namespace) -> int:
    """Plan and write; 1 when positions were left out. Raises `InputError`, `OutputError`."""
    from volid.exceptions import OutputError

    if not args.output.lower().endswith(".toml"):
        raise OutputError(f"{args.output}: a plan is a manifest; choose a name that ends in .toml, such as plan.toml")
    check_output(args.output, args.force, [path for path in (args.machine, args.solution) if path])
    with Progress() as progress:
        progress("planning")
        from volid.io import write_manifest

        plan = _plan(*_inputs(args), args)
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


def _inputs(args: argparse.Namespace) -> tuple[Machine, Campaign | None]:
    """The machine, and the campaign of the solution that is to be tested. Raises `InputError` without either."""
    from volid.exceptions import InputError
    from volid.io import read_machine
    from volid.io.solutions import read_solution

    fitted = read_solution(args.solution).campaign if args.solution else None
    if args.machine is None and fitted is None:
        raise InputError(
            "no machine is named; expected a machine file, or a solution that the plan is to test (`solution`)"
        )
    return fitted.machine if args.machine is None and fitted else read_machine(args.machine), fitted


def _plan(machine: Machine, fitted: Campaign | None, args: argparse.Namespace) -> Campaign:
    """The plan that is named, with the options that were given. Raises `InputError`."""
    from volid.cli.plan_tests import DESCRIBED, check_options
    from volid.planning.catalogue import MAKERS, VALIDATE, find_plan

    options = {name for described in DESCRIBED for name in described.parameters}
    given = {name: getattr(args, name) for name in sorted(options) if getattr(args, name) is not None}
    test = find_plan(machine, _named(args) or (VALIDATE if fitted else None))
    check_options(test, given)
    if fitted is not None:
        given["solution"] = fitted
    return MAKERS[test](machine, **given)


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
