"""The library of machines: every file loads, stands in the table, and its nominal chain is that of the exact matrices."""

import re

import jax.numpy as jnp
import numpy as np
import pytest
from support.machines import exact_of
from support.places import MODELS

from volid.io import read_machine
from volid.model.kinematics import deviation, functional_point, transform

FILES = sorted(MODELS.glob("*.toml"))
ROUNDING = 1e-11  # mm, over metres


def table() -> dict[str, list[str]]:
    """Cells of the README's table by file name."""
    rows = [
        line.strip("| \n").split("|") for line in (MODELS / "README.md").read_text().splitlines() if ".toml`" in line
    ]
    return {cells[0].strip(" `"): [cell.strip(" `") for cell in cells[1:]] for cells in rows if len(cells) > 3}


def travel(axis) -> str:
    return f"{axis.travel[0]:g} … {axis.travel[1]:g}"


def random_positions(machine, m: int = 20) -> tuple[np.ndarray, np.ndarray]:
    """Positions over the travels (m, n_axes) and tool vectors (m, 3)."""
    rng = np.random.default_rng(1)
    low, high = np.array([a.travel for a in machine.axes]).T
    return low + rng.random((m, len(low))) * (high - low), rng.uniform(-200.0, 200.0, (m, 3))


def test_there_are_machines_and_the_table_names_exactly_them():
    assert len(FILES) >= 15
    assert sorted(table()) == [file.name for file in FILES]


@pytest.mark.parametrize("file", FILES, ids=lambda file: file.stem)
def test_machine_loads_and_agrees_with_its_row_and_name(file):
    machine = read_machine(file)
    structure, *travels, rotary, _ = table()[file.name]
    assert structure == machine.structure
    assert travels == [travel(machine.axis(a)) for a in "XYZ"]
    turning = [a for a in "ABC" if a in machine.letters]
    assert rotary == (", ".join(f"{a} {travel(machine.axis(a))}" for a in turning) or "–")
    code = "".join(re.sub(r"\(.\)|['\s]", "", machine.structure))
    assert file.stem == code or file.stem.startswith(f"{code}_")
    assert sorted(machine.letters) == sorted(["X", "Y", "Z", *turning])


@pytest.mark.parametrize("file", FILES, ids=lambda file: file.stem)
def test_without_errors_there_is_no_deviation_and_the_chain_is_the_exact_one(file):
    machine = read_machine(file)
    q, tool = random_positions(machine)
    columns, vectors = jnp.asarray(q.T), tuple(jnp.asarray(tool.T))
    zero = jnp.zeros((6 * (len(machine.axes) + 1), len(q)))
    assert np.abs(deviation(machine, columns, vectors, zero)).max() < ROUNDING
    point = np.stack(functional_point(machine, columns, vectors), axis=1)
    np.testing.assert_allclose(point, exact_of(machine).functional_point(q, tool), rtol=0, atol=ROUNDING)


@pytest.mark.parametrize("file", FILES, ids=lambda file: file.stem)
def test_from_the_tool_to_the_workpiece_and_back(file):
    machine = read_machine(file)
    q, tool = random_positions(machine)
    n = len(machine.axes)
    errors = jnp.asarray(np.random.default_rng(2).normal(0.0, 2e-5, (6 * (n + 1), len(q))))
    there = transform(machine, jnp.asarray(q.T), errors, tuple(jnp.asarray(tool.T)), start=n)
    back = transform(machine, jnp.asarray(q.T), errors, there, start=0, stop=n)
    # rotations enter as 1 + ω + ω²/2, whose inverse is exact to ω³: 1e-14 rad over metres
    np.testing.assert_allclose(np.stack(back, axis=1), tool, rtol=0, atol=1e-10)


def test_structures_differ():
    structures = [read_machine(file).structure for file in FILES]
    assert len(set(structures)) == len(structures)


def test_the_layouts_of_five_axis_machines_are_there():
    rotary = [[(a.letter, a.primed) for a in read_machine(f).axes if not a.is_linear] for f in FILES]
    for layout in ("C'A'", "C'B'", "C'B", "CA", "CB", "A'", "B'"):
        assert layout in ["".join(letter + "'" * primed for letter, primed in axes) for axes in rotary]
