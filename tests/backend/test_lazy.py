"""JAX comes when it is needed: a small fit ends without it, and solutions are trees for JAX as `volid.backend.pytrees` says."""

import subprocess
import sys

import pytest
from support.places import BUNDLED as CAMPAIGN
from support.places import MODELS

FIT = f"solution = volid.fit(volid.load_campaign({str(CAMPAIGN)!r}))\n"
LEAVES = "assert len(jax.tree.leaves(solution)) == 5\n"


def run(code: str) -> None:
    """A fresh process that has to succeed."""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def test_a_small_fit_with_its_summary_and_grid_imports_no_jax(tmp_path):
    path = str(tmp_path / "solution.h5")
    commands = [
        ["fit", str(CAMPAIGN), "-o", path],
        ["summary", path],
        ["functions", path],
        ["grid", path, "--type", "L-VOL"],
    ]
    run(
        "import sys\nfrom volid.cli import main\n"
        f"for command in {commands}:\n    assert main(command) == 0, command\n"
        "assert not [m for m in sys.modules if m.split('.')[0] in ('jax', 'jaxlib', 'optimistix')]"
    )


def test_a_small_fit_in_python_imports_no_jax():
    run("import sys, volid\n" + FIT + "solution.functions()\nassert 'jax' not in sys.modules")


SIMULATION = f"""
import sys
from dataclasses import replace
import volid
from volid.campaign import Effect
from volid.io import read_machine
from volid.planning.standard import standard_plan

plan = standard_plan(read_machine({str(MODELS / "wYXbZt_vertical.toml")!r}), 2500)
effect = Effect("scatter", "repeatability", 1e-4, "point")
campaign, _ = volid.simulate(replace(plan, sets=tuple(replace(s, effects=(effect,)) for s in plan.sets)))
assert campaign.n_readings == 15_000
volid.fit(campaign)
assert "jax" not in sys.modules
"""


def test_a_simulation_and_a_fit_of_many_readings_import_no_jax():
    """More readings than one thread takes, with an effect that acts through sensitivities to axis positions."""
    run(SIMULATION)


def test_two_threads_may_use_jax_first():
    run(
        "import time\nfrom concurrent.futures import ThreadPoolExecutor\nfrom volid.backend.lazy import jax, jnp\n"
        "def later():\n    time.sleep(0.05)\n    return jnp.asarray([1.0]).sum()\n"
        "with ThreadPoolExecutor(2) as pool:\n"
        "    found = [pool.submit(lambda: jax.tree.leaves([1.0])), pool.submit(later)]\n"
        "    assert [float(f.result()[0]) if i == 0 else float(f.result()) for i, f in enumerate(found)] == [1.0, 1.0]\n"
    )


ORDERS = {
    "JAX first": "import jax\nimport volid\n" + FIT,
    "JAX before the fit": "import volid\nvolid.fit\nimport jax\n" + FIT,
    "JAX after the fit, and used by volid": "import volid\n" + FIT + "import jax\n"
    "solution.deviation([300.0, 200.0, -100.0], [0.0, 0.0, -150.0])\n",
    "JAX after the fit, and volid is told": "import volid\n" + FIT + "import jax\n"
    "from volid.backend.pytrees import register_waiting\nregister_waiting()\n",
    "JAX after the fit, and a copy": "import volid\n" + FIT + "import jax\n"
    "solution = volid.Solution(**vars(solution))\n",
}


@pytest.mark.parametrize("order", ORDERS.values(), ids=ORDERS)
def test_solutions_are_trees_whichever_comes_first(order):
    run(
        order + LEAVES + "assert jax.tree.leaves(solution.machine) == []\nimport jax.numpy as jnp\n"
        "tool = jnp.array([0.0, 0.0, -150.0])\n"
        "slopes = jax.grad(lambda s, q: s.deviation(q, tool)[0])(solution, jnp.array([300.0, 200.0, -100.0]))\n"
        "assert slopes.parameters.shape == solution.parameters.shape and bool(jnp.any(slopes.parameters != 0.0))\n"
    )


def test_importing_volid_changes_nothing_about_imports():
    run("import sys\nbefore = list(sys.meta_path)\nimport volid\n" + FIT + "assert sys.meta_path == before\n")


def test_arrays_of_a_solution_cannot_be_written_to():
    run(
        "import volid\n" + FIT + "try:\n    solution.parameters[0] = 1.0\nexcept ValueError:\n    pass\n"
        "else:\n    raise AssertionError('written')\n"
    )
