"""volid: identification of machine-tool geometry from tracker, ball-bar, R-test and direct measurements.

The public names, in the order of the work. They are imported on first use, so that `import volid` stays light.

>>> import volid
>>> machine = volid.load_machine("models/wYXbZt_vertical.toml")
>>> machine.letters
('Y', 'X', 'Z')
"""

import os as _os
import sys as _sys
from importlib import import_module as _import_module
from types import ModuleType as _ModuleType
from typing import TYPE_CHECKING
from typing import Any as _Any

# 64 bit throughout: 32 bit cannot hold 0.1 µm in 8 m. Set without importing JAX, so that `volid --help` stays fast.
_os.environ["JAX_ENABLE_X64"] = "1"
if "jax" in _sys.modules:
    _sys.modules["jax"].config.update("jax_enable_x64", True)
_import_module("volid.backend.threads")  # before NumPy, which reads the number of threads as it is loaded

if TYPE_CHECKING:
    from volid.campaign import Campaign, ObservationSet, Station
    from volid.compensation.base import base_of as compensation_base
    from volid.compensation.control import Control
    from volid.compensation.grids.linear import Grid, linear_grid
    from volid.compensation.grids.rotary import RotaryGrid, rotary_grids
    from volid.compensation.package import Compensation, compensate
    from volid.compensation.residual.forecast import Forecast, forecast
    from volid.compensation.residual.volume import predict_residual, volumetric_summary
    from volid.compensation.rigid import best_rigid
    from volid.compensation.tables.by_function import error_tables
    from volid.compensation.tables.error_table import ErrorTable
    from volid.compensation.types import TYPES as COMPENSATION_TYPES
    from volid.exceptions import InputError, NotDeterminedError, OutputError, VolidError
    from volid.fitting.datum import parse_datum
    from volid.fitting.fit import fit
    from volid.fitting.location_errors import LocationError, location_errors
    from volid.fitting.solution import Solution
    from volid.fitting.streamed import fit_streamed
    from volid.io import load_campaign
    from volid.io import read_machine as load_machine
    from volid.io import write_campaign as save_campaign
    from volid.io.campaign.stream import CampaignStream
    from volid.io.compensations import load_control, save_compensation
    from volid.io.grids import read_grid as load_grid
    from volid.io.grids import save_grid
    from volid.io.solutions import read_solution as load_solution
    from volid.io.solutions import write_solution as save_solution
    from volid.io.table_reader import read_table as load_table
    from volid.model.machine import Datum, Machine
    from volid.planning.standard import standard_plan
    from volid.plausibility.checks import check_campaign, closures
    from volid.report.summary import summary
    from volid.virtual.random_truth import random_truth
    from volid.virtual.simulate import simulate
    from volid.virtual.truth import Truth

__all__ = [  # in the order of the work  # noqa: RUF022
    # machine and campaign
    "load_machine",
    "Machine",
    "Datum",
    "load_campaign",
    "save_campaign",
    "Campaign",
    "Station",
    "ObservationSet",
    "check_campaign",
    "closures",
    # a virtual machine instead of a real one
    "standard_plan",
    "random_truth",
    "Truth",
    "simulate",
    # identification
    "fit",
    "CampaignStream",
    "fit_streamed",
    "parse_datum",
    "Solution",
    "save_solution",
    "load_solution",
    "summary",
    "location_errors",
    "LocationError",
    # compensation
    "linear_grid",
    "Grid",
    "rotary_grids",
    "RotaryGrid",
    "save_grid",
    "load_grid",
    "COMPENSATION_TYPES",
    "compensation_base",
    "compensate",
    "Compensation",
    "error_tables",
    "ErrorTable",
    "load_table",
    "save_compensation",
    "load_control",
    "Control",
    "best_rigid",
    "volumetric_summary",
    "predict_residual",
    "forecast",
    "Forecast",
    # what can go wrong
    "VolidError",
    "InputError",
    "OutputError",
    "NotDeterminedError",
]
_PLACES = {
    "volid.campaign": ("Campaign", "ObservationSet", "Station"),
    "volid.plausibility.checks": ("check_campaign", "closures"),
    "volid.compensation.control": ("Control",),
    "volid.compensation.base": ("base_of as compensation_base",),
    "volid.compensation.grids.linear": ("Grid", "linear_grid"),
    "volid.compensation.package": ("Compensation", "compensate"),
    "volid.compensation.residual.forecast": ("Forecast", "forecast"),
    "volid.compensation.rigid": ("best_rigid",),
    "volid.compensation.grids.rotary": ("RotaryGrid", "rotary_grids"),
    "volid.compensation.tables.error_table": ("ErrorTable",),
    "volid.compensation.tables.by_function": ("error_tables",),
    "volid.compensation.types": ("TYPES as COMPENSATION_TYPES",),
    "volid.compensation.residual.volume": ("predict_residual", "volumetric_summary"),
    "volid.exceptions": ("VolidError", "InputError", "OutputError", "NotDeterminedError"),
    "volid.fitting.datum": ("parse_datum",),
    "volid.fitting.fit": ("fit",),
    "volid.fitting.location_errors": ("location_errors", "LocationError"),
    "volid.fitting.solution": ("Solution",),
    "volid.fitting.streamed": ("fit_streamed",),
    "volid.io": ("load_campaign", "read_machine as load_machine", "write_campaign as save_campaign"),
    "volid.io.campaign.stream": ("CampaignStream",),
    "volid.io.compensations": ("load_control", "save_compensation"),
    "volid.io.grids": ("read_grid as load_grid", "save_grid"),
    "volid.io.solutions": ("read_solution as load_solution", "write_solution as save_solution"),
    "volid.io.table_reader": ("read_table as load_table",),
    "volid.model.machine": ("Datum", "Machine"),
    "volid.virtual.random_truth": ("random_truth",),
    "volid.report.summary": ("summary",),
    "volid.virtual.simulate": ("simulate",),
    "volid.planning.standard": ("standard_plan",),
    "volid.virtual.truth": ("Truth",),
}
# public name: (module, name there)
_SOURCES = {n.split(" as ")[-1]: (module, n.split(" as ")[0]) for module, names in _PLACES.items() for n in names}


def __getattr__(name: str) -> _Any:
    if name == "__version__":
        from importlib.metadata import version

        return version("volid")
    if name not in _SOURCES:
        raise AttributeError(f"module 'volid' has no attribute '{name}'")
    module, original = _SOURCES[name]
    value = globals()[name] = getattr(_import_module(module), original)
    _complete_solution()
    return value


def __dir__() -> list[str]:
    return [*__all__, "__version__"]


def _complete_solution() -> None:
    """Give `Solution` the methods whose work is done in layers above it: `save`, `grid` and `monte_carlo`."""
    loaded = _sys.modules.get("volid.fitting.solution")
    if loaded is not None and not hasattr(loaded.Solution, "save"):
        loaded.Solution.save = _import_module("volid.io.solutions").write_solution
        loaded.Solution.monte_carlo = _import_module("volid.uncertainty.trials.monte_carlo").monte_carlo
        loaded.Solution.grid = _import_module("volid.compensation.grids.linear").linear_grid


class _Package(_ModuleType):
    """`volid.simulate` is the function, also after something has imported the module of that name."""

    def __setattr__(self, name: str, value: _Any) -> None:
        if not (name in _SOURCES and isinstance(value, _ModuleType)):
            super().__setattr__(name, value)


_sys.modules[__name__].__class__ = _Package
