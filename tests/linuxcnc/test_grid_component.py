"""The component's C code without HAL: it reads and refuses the same files as volid, and interpolates linearly."""

import ctypes
import shutil
import subprocess

import numpy as np
import pytest
from support.control_cases import spatial, written
from support.mutated_text import mutated
from support.places import ROOT
from support.volumetric import corrections

from volid.controllers.base import text_of
from volid.controllers.linuxcnc.hal.text import HalGrid, read_grid, write_grid
from volid.exceptions import InputError

pytestmark = pytest.mark.skipif(shutil.which("gcc") is None, reason="no gcc, which compiles the component")

HEADER = ROOT / "examples" / "linuxcnc" / "volid_grid.h"
# what a caller without HAL needs: one grid, read and asked
SHELL = f"""#include "{HEADER}"
static volid_grid grid;
int load(const char *name, char *problem) {{ volid_free(&grid); return volid_read(name, &grid, problem); }}
int ask(const double *at, double *found) {{ return volid_correction(&grid, at, found); }}
"""


class Component:
    """The compiled code: `load` a text, `ask` at positions."""

    def __init__(self, folder) -> None:
        source, self.file = folder / "grid.c", folder / "some.grid"
        source.write_text(SHELL, encoding="utf-8")
        flags = [
            "-O2",
            "-Wall",
            "-Wextra",
            "-Werror",
            "-fsanitize=undefined",
            "-fno-sanitize-recover",
            "-static-libubsan",
        ]
        subprocess.run(["gcc", *flags, "-shared", "-fPIC", source, "-o", folder / "grid.so", "-lm"], check=True)
        self.code = ctypes.CDLL(str(folder / "grid.so"))

    def load(self, text: str | bytes) -> str | None:
        """What is wrong with a text, or None."""
        self.file.write_bytes(text.encode() if isinstance(text, str) else text)
        problem = ctypes.create_string_buffer(200)
        return None if self.code.load(str(self.file).encode(), problem) else problem.value.decode(errors="replace")

    def ask(self, positions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Corrections (m, 3), and whether each position lies beyond the nodes (m,)."""
        found, beyond, at = np.empty((len(positions), 3)), np.empty(len(positions), bool), (ctypes.c_double * 3)()
        for i, place in enumerate(positions):
            beyond[i] = self.code.ask((ctypes.c_double * 3)(*place), at)
            found[i] = at
        return found, beyond


@pytest.fixture(scope="module")
def component(tmp_path_factory) -> Component:
    return Component(tmp_path_factory.mktemp("component"))


def irregular(unit: str = "mm") -> str:
    """A grid with free spacing and values that no sum of functions makes."""
    rng = np.random.default_rng(3)
    x, y, z = (
        np.array([-5.0, 0.0, 1.0, 90.0, 400.0]),
        np.array([0.0, 299.0, 300.0]),
        np.array([-250.0, -30.0, 0.0, 11.0]),
    )
    return write_grid(HalGrid("L-VOL", (0.0, 0.0, -150.0), unit, (x, y, z), rng.normal(0.0, 0.02, (5, 3, 4, 3))))


def test_it_interpolates_linearly_in_each_direction(component):
    text = irregular()
    assert component.load(text) is None
    rng = np.random.default_rng(4)
    q = rng.uniform([-5.0, 0.0, -250.0], [400.0, 300.0, 11.0], (2000, 3))
    q[:4] = [[-5.0, 0.0, -250.0], [400.0, 300.0, 11.0], [1.0, 299.0, -30.0], [90.0, 0.0, 0.0]]
    found, beyond = component.ask(q)
    np.testing.assert_allclose(found, corrections(text)(q), rtol=0, atol=1e-15)
    assert not beyond.any()


def test_last_values_are_held_beyond_the_nodes(component):
    text = irregular()
    component.load(text)
    q = np.array([[-6.0, 10.0, 0.0], [1e9, 301.0, 12.0], [5.0, -1e-9, -300.0], [np.nan, 0.0, 0.0], [5.0, 10.0, 0.0]])
    held = np.clip(np.where(np.isnan(q), -5.0, q), [-5.0, 0.0, -250.0], [400.0, 300.0, 11.0])
    found, beyond = component.ask(q)
    np.testing.assert_allclose(found, corrections(text)(held), rtol=0, atol=1e-15)
    assert beyond.tolist() == [True, True, True, False, False]


def test_an_axis_with_one_node_changes_nothing(component):
    held = HalGrid(
        "L-VOL", (0.0, 0.0, 0.0), "mm", (np.array([0.0, 10.0]), np.zeros(1), np.zeros(1)), np.zeros((2, 1, 1, 3))
    )
    held.values[1, 0, 0] = [0.010, -0.020, 0.030]
    assert component.load(write_grid(held)) is None
    found, beyond = component.ask(np.array([[5.0, 77.0, -3.0], [10.0, 0.0, 0.0]]))
    np.testing.assert_allclose(found, [[0.005, -0.010, 0.015], [0.010, -0.020, 0.030]], rtol=0, atol=1e-16)
    assert not beyond.any()


@pytest.mark.parametrize(
    ("old", "new", "problem"),
    [
        ("volid-hal-grid 1", "volid-hal-grid 2", "line 1: found '2', expected 1"),
        ("unit mm", "unit cm", "found 'cm', expected one of: mm inch "),
        ("sign compensation", "sign error", "found 'error', expected compensation"),
        ("nodes X 3 0 500", "nodes X 3 0 0", "found '0', expected rising positions of nodes"),
        ("values 12", "values 13", "found '13', expected the product of the numbers of nodes"),
        ("nodes Y 2", "nodes Y two", "found 'two', expected a number of nodes"),
        ("\nend", "\n0 0 0\nend", "found '0', expected end"),
        ("\nend\n", "\n", "found the end of the file, expected end"),
        ("\nend\n", "\nend of it\n", "found 'of', expected nothing after 'end'"),
        ("-0.002000000", "-0,002000000", "found '-0,002000000', expected a number"),
        ("-0.002000000", "-0.002" + "0" * 70, "0000', expected a number"),
        ("\nend\n", "\nend\n" + "x" * 64 + "\n", "x', expected nothing after 'end'"),
        ("-0.002000000", "nan", "found 'nan', expected a number"),
    ],
)
def test_damage_is_named_with_its_line(component, old, new, problem):
    text = written("linuxcnc-hal", spatial())["l_vol.grid"]
    assert old in text
    found = component.load(text.replace(old, new, 1))
    assert found is not None and problem in found and found.startswith("line ")


def test_it_reads_and_refuses_the_same_files_as_volid(component):
    rng, text = np.random.default_rng(5), written("linuxcnc-hal", spatial())["l_vol.grid"].encode()
    q, kept = np.array([[333.0, 222.0, -111.0]]), 0
    for _ in range(600):
        damaged = mutated(text, rng)
        here, decoded = component.load(damaged), text_of("some.grid", damaged)
        try:
            held = read_grid("some.grid", decoded)
        except InputError as error:
            assert here is not None, f"read by the component, but not by volid: {error}"
            continue
        assert here is None, f"read by volid, but not by the component: {here}"
        kept += 1
        if held.unit == "mm":
            field = corrections(decoded)
            low, high = np.array([(n[0], n[-1]) for n in field.grid]).T
            np.testing.assert_allclose(component.ask(q)[0], field(np.clip(q, low, high)), rtol=0, atol=1e-9)
    assert 20 < kept < 400
