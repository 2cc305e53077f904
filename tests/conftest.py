"""Small fitted campaigns that several test files share, and the environment that every test runs in."""
# ruff: noqa: E402

import os
import sys
from pathlib import Path

os.environ.setdefault("JAX_PLATFORMS", "cpu")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

from volid.cli.environment import cache_folder, cache_programs

# before anything imports JAX: compiling takes longer than the tests themselves
cache_programs(cache_folder() / "tests")

import numpy as np
import pytest
from jaxtyping import install_import_hook
from support.shape_checks import MODULES

install_import_hook(MODULES, "support.shape_checks.checked")  # before anything imports them

from exact_chain import ExactMachine, Truth, machine_toml, random_truth, tracker_campaign, write_campaign
from support.small_campaign import ONLY_C, RICH, SINGLE_TOOL, TRAVEL, Virtual, fitted, make_campaign

pytest_plugins = ["support.commands", "support.leftovers", "support.order"]


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
