"""`volid simulate`: a campaign measured on a virtual machine, with the truth beside it."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

from volid.cli.common import HDF5, add_allow_outside, add_output, check_output, conclude, explain, print_json, tell
from volid.cli.control_options import add_control, control_from, loaded_files
from volid.cli.left_over import left_out
from volid.cli.numbers import add_unusual, seed
from volid.cli.progress import Progress

if TYPE_CHECKING:
    from volid.campaign import Campaign
    from volid.model.machine import Machine
    from volid.virtual.truth import Truth

HELP = "a campaign measured on a virtual machine, with the truth stored beside it"
MANIFEST = "campaign.toml"

_EPILOG = """\
PLAN is a campaign manifest whose CSV files lack the readings (distance, value …). Its positions of
stations are the true ones; in the campaign, unknown stations stand about 5 mm off. MACHINE is
measured, whatever machine the plan was made for; both need the same axes.

Without --truth the machine's errors are random. Errors, true stations and dead paths are written
beside the campaign, with the ending .truth.h5. The same seed gives the same readings.

With --compensation a control corrects the machine while it is measured: the campaign holds the
programmed positions, the readings are those of the pose that the corrected drives reach, and
[conditions] active_compensations records what was active. An axis that rests, and is moved by
corrections alone, arrives in the direction of the last of these. The truth stays that of the machine.

CAMPAIGN is one HDF5 file when it ends in .h5 or .hdf5, else a folder for campaign.toml and its
CSV files.

example:
  volid simulate models/wYXbZt_vertical.toml --plan plan.toml --seed 7 -o campaign.h5
  volid simulate models/wYXbZt_vertical.toml --plan plan.toml --truth campaign.truth.h5 \\
      --compensation grid.csv --increment X=0.001,Y=0.001,Z=0.001 -o after.h5

exit status: 0 good; 1 written, but the plan needs attention (positions outside the travel …);
2 bad input
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    explain(parser, _EPILOG)
    parser.add_argument("machine", metavar="MACHINE", help="machine file (TOML)")
    parser.add_argument(
        "--plan", metavar="PLAN.toml", required=True, help="what to measure, a manifest without readings"
    )
    parser.add_argument("--truth", metavar="TRUTH.h5", help="true errors, a truth or a solution; default: random")
    add_control(parser)
    parser.add_argument("--seed", type=seed, default=0, metavar="N", help="of everything random; default 0")
    add_unusual(parser)
    add_allow_outside(parser)
    add_output(parser, "CAMPAIGN", "campaign: a file ending in .h5, or a folder for text", required=True)


def run(args: argparse.Namespace) -> int:
    """Simulate, write, summarise; 1 when the plan needs attention. Raises `InputError`, `OutputError`."""
    from volid.io import load_campaign, read_machine
    from volid.io.campaign.active_files import with_loaded
    from volid.io.simulations import write_simulation
    from volid.plausibility.checks import check_campaign
    from volid.virtual.simulate import simulate

    paths = _places(Path(args.output))
    _check_places(paths, args)
    with Progress() as progress:
        progress("reading the plan")
        machine, plan = (
            read_machine(args.machine),
            load_campaign(args.plan, plan=True, allow_outside=args.allow_outside),
        )
        truth, control = _truth(args, machine), control_from(args, machine)
        progress(f"simulating {plan.n_readings} readings")
        campaign, truth = simulate(plan, truth, seed=args.seed, control=control)
        notes = _not_loaded(plan, args)
        if control is not None:
            loaded = loaded_files(args, machine)
            campaign = with_loaded(campaign, control, loaded)
            notes += left_out(args.compensation, loaded)
        warnings = (*check_campaign(campaign), *([] if control is None else control.corrected_twice))
    write_simulation(campaign, truth, *paths, overwrite=args.force)
    if args.json:
        print_json(_as_json(campaign, truth, args.seed, paths, warnings))
    else:
        print("\n".join(_summary(campaign, plan.machine, truth, args.seed, paths)))
    tell(args, notes)
    return conclude(args, warnings)


def _not_loaded(plan: Campaign, args: argparse.Namespace) -> list[str]:
    """A note where the plan's record names files of a control as active: they are not loaded for that."""
    if args.compensation or not plan.active_files or plan.conditions.get("simulated"):
        return []
    return [
        f"the plan says that {', '.join(a.text for a in plan.active_files)} is active; the virtual machine moves without it. "
        "Load the file with --compensation, unless the truth is that of the machine with it"
    ]


def _truth(args: argparse.Namespace, machine: Machine) -> Truth:
    """The errors of the file, on the machine that is measured; random ones without a file."""
    from dataclasses import replace

    from volid.io.truths import load_truth
    from volid.virtual.random_truth import random_truth

    return random_truth(machine, args.seed) if args.truth is None else replace(load_truth(args.truth), machine=machine)


def _places(output: Path) -> tuple[Path, Path]:
    """Where campaign and truth go: CAMPAIGN.h5 and CAMPAIGN.truth.h5, or campaign.toml and campaign.truth.h5 in a folder."""
    from volid.exceptions import OutputError

    if output.suffix.lower() == ".toml" and output.name != MANIFEST:
        raise OutputError(f"{output}: a manifest is always called {MANIFEST}; name its folder, or a file ending in .h5")
    if output.suffix.lower() not in (*HDF5, ".toml"):
        output = output / MANIFEST
    return output, output.with_name(f"{output.stem}.truth.h5")


def _check_places(paths: tuple[Path, Path], args: argparse.Namespace) -> None:
    """Before any work: neither file is written when one of them cannot be."""
    inputs = [path for path in (args.machine, args.plan, args.truth, *args.compensation) if path is not None]
    for path in paths:
        new_folder = paths[0].name == MANIFEST and not path.parent.exists()
        check_output(path.parent if new_folder else path, args.force, inputs)


def _summary(campaign: Campaign, planned: Machine, truth: Truth, seed: int, paths: tuple[Path, Path]) -> list[str]:
    """What was measured on what, and where it went, in a few lines."""
    from volid.plausibility.conditions import active_compensations

    machine = campaign.machine
    lines = [f"machine '{machine.name}', {machine.structure}; {truth.source}; seed {seed}"]
    if planned.structure != machine.structure or planned.name != machine.name:
        lines.append(
            f"the plan was made for '{planned.name}', {planned.structure}; its positions are taken as they are"
        )
    lines += [f"set '{s.name}': {len(s)} rows of kind {s.kind}" for s in campaign.sets]
    effects = dict.fromkeys(e.name for s in campaign.sets for e in s.effects)
    if effects:
        lines.append(f"systematic effects drawn from their u: {', '.join(effects)}")
    lines += [f"active compensation: {text}" for text in active_compensations(campaign.conditions)]
    return [*lines, f"campaign: {paths[0]}", f"truth: {paths[1]}"]


def _as_json(
    campaign: Campaign, truth: Truth, seed: int, paths: tuple[Path, Path], warnings: tuple[str, ...]
) -> dict[str, Any]:
    from volid.plausibility.conditions import active_compensations

    return {
        "campaign": str(paths[0]),
        "truth": str(paths[1]),
        "machine": campaign.machine.name,
        "structure": campaign.machine.structure,
        "seed": seed,
        "errors": truth.source,
        "active_compensations": active_compensations(campaign.conditions),
        "stations": len(campaign.stations),
        "readings": campaign.n_readings,
        "sets": [{"set": s.name, "kind": s.kind, "rows": len(s)} for s in campaign.sets],
        "warnings": list(warnings),
    }
