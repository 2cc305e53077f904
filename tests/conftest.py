"""Small fitted campaigns that several test files share, and the environment that every test runs in."""
# ruff: noqa: E402

import os
import sys
from dataclasses import dataclass
from pathlib import Path

os.environ.setdefault("JAX_PLATFORMS", "cpu")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

from volid.cli.environment import cache_folder, cache_programs

# before anything imports JAX: compiling takes longer than the tests themselves
cache_programs(cache_folder() / "tests")

import numpy as np
import pytest
from jaxtyping import install_import_hook
from leftovers import pytest_runtest_setup, pytest_runtest_teardown  # noqa: F401
from shape_checks import MODULES

install_import_hook(MODULES, "shape_checks.checked")  # before anything imports them

from exact_chain import (
    ExactMachine,
    TrackerCampaign,
    Truth,
    machine_toml,
    random_truth,
    tracker_campaign,
    write_campaign,
)

TRAVEL = {"X": (0.0, 1000.0), "Y": (0.0, 600.0), "Z": (-500.0, 0.0)}
SINGLE_TOOL = (0.0, 0.0, -150.0)
COARSE = "[model]\nsegments = 2\n"
RICH = """[model]
segments = 2
[model.functions]
EXX = { reversal = "constant" }
EYY = { reversal = true }
EZZ = { over = ["Z", "X"], segments = [2, 1] }
"""
ONLY_C = """[model]
segments = 8
[model.functions]
"E*[XYZS]" = false
"""
LEVELS = """
[[set]]
name = "levels"
kind = "component"
file = "levels.csv"
tool = [0.0, 0.0, -150.0]
u = 1.0e-6
"""


@dataclass(frozen=True)
class Virtual:
    """A campaign on the independent virtual machine: its manifest, and everything that is true about it."""

    manifest: Path
    machine: ExactMachine
    truth: Truth
    campaign: TrackerCampaign


def make_campaign(
    folder: Path, *, model: str = COARSE, waviness: float = 0.3, reversal=False, levels: bool = False, **options
) -> Virtual:
    """Write a small campaign of six stations on a cross-table vertical machine; `options` for `tracker_campaign`."""
    machine, rng = ExactMachine("w Y' X' b Z (C) t", TRAVEL), np.random.default_rng(5)
    truth = random_truth(machine, rng, waviness=waviness, scale=0.3, reversal=reversal)
    options = {"n_per_station": 60, "every_station_sees_every_tool": True} | options
    campaign = tracker_campaign(machine, truth, rng, **options)
    text = machine_toml(machine, name="Testmaschine Ω", extra=model)
    manifest = write_campaign(folder, campaign, text, "Abnahme 2026", approximate_error=5.0, rng=rng)
    if levels:
        _add_levels(manifest, machine, truth, rng)
    return Virtual(manifest, machine, truth, campaign)


def _add_levels(manifest: Path, machine: ExactMachine, truth: Truth, rng: np.random.Generator) -> None:
    """A level on the table: roll of X at eleven positions, forward and backward."""
    x = np.concatenate([np.linspace(0.0, 1000.0, 11), np.linspace(1000.0, 0.0, 11)])
    q = machine.in_axis_order({"X": x, "Y": 300.0, "Z": -250.0})
    roll = machine.deviation(q, SINGLE_TOOL, truth)[:, 3] + 1e-6 * rng.standard_normal(len(x))
    lines = [f"{a!r},300.0,-250.0,A,{v!r}" for a, v in zip(x.tolist(), roll.tolist(), strict=True)]
    (manifest.parent / "levels.csv").write_text("\n".join(["X,Y,Z,component,value", *lines]) + "\n")
    manifest.write_text(manifest.read_text(encoding="utf-8") + LEVELS, encoding="utf-8")


def fitted(virtual: Virtual, **options):
    """The solution of a virtual campaign, with provenance as `volid fit` records it."""
    from dataclasses import replace

    from volid.fitting.fit import fit
    from volid.io import load_campaign
    from volid.io.basics.provenance import provenance

    record = provenance([virtual.manifest], ["volid", "fit"], options)
    return replace(fit(load_campaign(virtual.manifest), **options), provenance=record)


def pytest_collection_modifyitems(items):
    """Long statistics take the time they take."""
    for item in items:
        if item.get_closest_marker("long"):
            item.add_marker(pytest.mark.timeout(0))


@pytest.fixture(autouse=True, scope="module")
def forget_programs():
    """Compiled programs of one test file are of no use to the next; kept, they would fill gigabytes."""
    yield
    jax = sys.modules.get("jax")
    if jax is not None:
        jax.clear_caches()


@pytest.fixture(scope="session")
def virtual(tmp_path_factory) -> Virtual:
    """Three tool vectors, an error model that can follow the truth: everything determined, nothing to complain about."""
    return make_campaign(tmp_path_factory.mktemp("good"))


@pytest.fixture(scope="session")
def solution(virtual):
    """Solution of `virtual`: accepted by the data."""
    return fitted(virtual)


@pytest.fixture(scope="session")
def single_tool(tmp_path_factory) -> Virtual:
    """One tool vector only: roll and more are not determined, the tool rotation is held."""
    return make_campaign(tmp_path_factory.mktemp("single"), tools=SINGLE_TOOL)


@pytest.fixture(scope="session")
def single_tool_solution(single_tool):
    """Solution of `single_tool`."""
    return fitted(single_tool)


@pytest.fixture(scope="session")
def rejected_solution(tmp_path_factory):
    """Solution whose error model is too coarse for a wavy machine: rejected by the data."""
    return fitted(make_campaign(tmp_path_factory.mktemp("wavy"), waviness=1.5))


@pytest.fixture(scope="session")
def outlier_solution(tmp_path_factory):
    """Robust solution of a campaign with gross outliers."""
    return fitted(make_campaign(tmp_path_factory.mktemp("outliers"), outlier_fraction=0.03), robust=True)


@pytest.fixture(scope="session")
def rich_solution(tmp_path_factory):
    """Solution with reversal (constant and as a function), a cross effect, approach directions and a second set."""
    options = {"model": RICH, "reversal": ("EXX", "EYY"), "levels": True}
    return fitted(make_campaign(tmp_path_factory.mktemp("rich"), **options))


@pytest.fixture(scope="session")
def rotary_solution(tmp_path_factory):
    """Solution of a rotary table alone: periodic splines, coupled functions, location errors."""
    machine = ExactMachine("w C' b X Y Z t", TRAVEL | {"C": (0.0, 360.0)}, point={"C": (500.0, 300.0, -400.0)})
    rng = np.random.default_rng(5)
    truth = random_truth(machine, rng, waviness=0.5, scale=0.3)
    functions, constants = truth.functions, truth.constants
    truth = Truth(
        {n: f for n, f in functions.items() if n[2] == "C"}, {n: constants[n] for n in constants if "0C" in n}
    )
    campaign = tracker_campaign(machine, truth, rng, n_per_station=60, every_station_sees_every_tool=True)
    text = machine_toml(machine, name="Rundtisch", extra=ONLY_C)
    folder = tmp_path_factory.mktemp("rotary")
    manifest = write_campaign(folder, campaign, text, "Tisch", approximate_error=5.0, rng=rng)
    return fitted(Virtual(manifest, machine, truth, campaign))


@pytest.fixture(scope="session")
def solution_file(solution, tmp_path_factory) -> Path:
    """`solution` as a file."""
    from volid.io.solutions import write_solution

    path = tmp_path_factory.mktemp("files") / "solution.h5"
    write_solution(solution, path)
    return path
