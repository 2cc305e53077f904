"""Grids that controls add to the axes as they are, on machines whose linear axes turn with a rotary axis."""

from dataclasses import replace

import numpy as np
import pytest
from support.control_cases import TOOL, error_table, job, spatial

import volid
from volid.compensation.package import Compensation
from volid.controllers import CONTROLS
from volid.controllers.base import options_of
from volid.exceptions import InputError
from volid.io.machines import parse_machine

OPTIONS = {"isg-volcomp": {"form": "grid"}, "pmac": {"counts": "10000"}}
HEAD, CARRIED = "w b C X Z Y t", "w X' Y' C' b Z t"


def machine(structure: str) -> volid.Machine:
    """X, Y, Z as in `support.control_cases`, with C about the origin."""
    travels = {"X": (0.0, 1000.0), "Y": (0.0, 600.0), "Z": (-500.0, 0.0), "C": (0.0, 360.0)}
    lines = ['format = "volid-machine/1"', 'name = "turning"', f'structure = "{structure}"']
    for letter, (low, high) in travels.items():
        lines += [f"[axis.{letter}]", f"travel = [{low}, {high}]"] + ["point = [0.0, 0.0, 0.0]"] * (letter == "C")
    return parse_machine("\n".join(lines) + "\n", "turning.toml")


def over(name: str) -> Compensation:
    """The grid that a control takes: over X, Y, Z, of pmac over X and Y."""
    made = spatial()
    (grid,) = made.grids
    if name != "pmac":
        return made
    low = grid.positions[:, 2] == -500.0
    rows = {n: getattr(grid, n)[low] for n in ("values", "u", "outside")}
    return Compensation(
        made.names,
        (),
        (replace(grid, axes=("X", "Y"), nodes=grid.nodes[:2], positions=grid.positions[low, :2], **rows),),
    )


@pytest.mark.parametrize("name", ["linuxcnc-hal", "fanuc-3d", "pmac", "isg-volcomp"])
@pytest.mark.parametrize(("structure", "axes"), [(HEAD, "X, Z, Y"), (CARRIED, "X, Y")])
def test_a_grid_is_refused_with_what_carries_it(name, structure, axes):
    sign = "error" if name == "fanuc-3d" else None
    options = OPTIONS.get(name, {})
    CONTROLS[name].write(job(name, over(name), sign, **options))  # without a rotary axis it is written
    carries = (
        "heidenhain-kinematicscomp and csv" if structure == CARRIED else r"isg-volcomp \(option form=tables\), etalon, "
    )
    with pytest.raises(
        InputError, match=f"{name}: {axes} of '{structure}' turn with a rotary axis; .* carried by {carries}"
    ):
        CONTROLS[name].write(job(name, over(name), sign, machine=machine(structure), **options))


@pytest.mark.parametrize(
    ("name", "structure"),
    [
        ("isg-volcomp", HEAD),
        ("etalon", HEAD),
        *((name, structure) for name in ("heidenhain-kinematicscomp", "csv") for structure in (HEAD, CARRIED)),
    ],
)
def test_what_the_refusal_names_turns_with_the_axis(name, structure):
    """Read back, tables of error functions correct a pitch of 20 µrad and 10 µm of positioning at C = 90 as they should."""
    turned, options = machine(structure), {"form": "tables"} if name == "isg-volcomp" else {}
    tables = (error_table("EXX", [0, 500, 1000], [0.0, 0.010, -0.004]), error_table("EAY", [0, 600], [0.0, 20e-6]))
    made = Compensation(("L-VOL",), tables, ())
    sign = "error" if name == "heidenhain-kinematicscomp" else None
    asked = job(name, made, sign, machine=turned, **options)
    files = {f.name: f.content for f in CONTROLS[name].write(asked).files}
    stated = {**options_of(CONTROLS[name].declaration, options), "sign": asked.sign}
    back = CONTROLS[name].read(files, turned, stated)
    at = turned.order(X=500.0, Y=600.0, Z=-250.0, C=90.0)[None]
    wanted, held = (m.control(turned).command(at, TOOL) for m in (made, back))
    assert np.abs(wanted - at).max() > 0.009
    np.testing.assert_allclose(held, wanted, atol=2e-6, rtol=0.0)
