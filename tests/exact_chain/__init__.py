"""Independent virtual machine: exact 4x4 matrices in plain NumPy and SciPy, nothing from volid or JAX.

Written from the conventions alone, to judge the package. Units: mm, rad; rotary positions in degrees. Arrays of axis
positions `q` have shape (m, number of axes), columns in the order of the structural code, workpiece to tool.
"""

from exact_chain.control import CompensatedMachine, ExactControl
from exact_chain.files import machine_toml, write_campaign
from exact_chain.gauge import gauge_basis, gauge_free
from exact_chain.machine import ExactMachine, machine_grid
from exact_chain.motions import COMPONENTS, LINEAR, MICRO, MICROMETRE, ROTARY, apply, rigid, unit
from exact_chain.random_rotary import one_turn
from exact_chain.random_truth import random_truth
from exact_chain.tracker import (
    TrackerCampaign,
    approach_directions,
    default_stations,
    default_tools,
    spread_positions,
    tracker_campaign,
)
from exact_chain.truth import Product, Smooth, Truth

__all__ = [
    "COMPONENTS",
    "LINEAR",
    "MICRO",
    "MICROMETRE",
    "ROTARY",
    "CompensatedMachine",
    "ExactControl",
    "ExactMachine",
    "Product",
    "Smooth",
    "TrackerCampaign",
    "Truth",
    "apply",
    "approach_directions",
    "default_stations",
    "default_tools",
    "gauge_basis",
    "gauge_free",
    "machine_grid",
    "machine_toml",
    "one_turn",
    "random_truth",
    "rigid",
    "spread_positions",
    "tracker_campaign",
    "unit",
    "write_campaign",
]
