"""volid: identification of machine-tool geometry from tracker, ball-bar, R-test and direct measurements.

Why public names are imported late: importing JAX takes as long as a fit of some thousand readings. Therefore `import volid` and
such a fit do not import it, and `volid --help` does not import NumPy either. Three measures achieve that. A public name is
imported from its module when it is first asked for (`__getattr__` below; `__init__.pyi` states the same for type checkers).
Modules take JAX from `volid.backend.lazy`, which imports it at first use. Classes that JAX sees as trees of arrays wait in
`volid.backend.pytrees` until JAX has been imported.

>>> import volid
>>> machine = volid.load_machine("models/wYXbZt_vertical.toml")
>>> machine.letters
('Y', 'X', 'Z')
"""

import os as _os
import sys as _sys
from importlib import import_module as _import_module
from typing import Any as _Any

# 64 bit throughout: 32 bit cannot hold 0.1 µm in 8 m. Set without importing JAX, so that `volid --help` stays fast.
_os.environ["JAX_ENABLE_X64"] = "1"
if "jax" in _sys.modules:
    _sys.modules["jax"].config.update("jax_enable_x64", True)
_import_module("volid.backend.threads")  # before NumPy, which reads the number of threads as it is loaded
_sys.modules["volid.plot"] = _import_module(
    "volid.report.plot"
)  # a table of names: for `from volid.plot import polar_plot`

_PUBLIC = {  # public name: where it comes from, in the order of the work
    # machine and campaign
    "load_machine": "volid.io:read_machine",
    "Machine": "volid.model.machine:Machine",
    "Datum": "volid.model.machine:Datum",
    "load_campaign": "volid.io:load_campaign",
    "save_campaign": "volid.io:write_campaign",
    "Campaign": "volid.campaign:Campaign",
    "Station": "volid.campaign:Station",
    "Alignment": "volid.campaign:Alignment",
    "Environment": "volid.campaign:Environment",
    "Expansion": "volid.campaign:Expansion",
    "ObservationSet": "volid.campaign:ObservationSet",
    "ActiveFiles": "volid.campaign:ActiveFiles",
    "End": "volid.campaign:End",
    "check_campaign": "volid.plausibility.checks:check_campaign",
    "closures": "volid.plausibility.checks:closures",
    "repeatability": "volid.fitting.repeatability:repeatability",
    # a virtual machine instead of a real one
    "standard_plan": "volid.planning.standard:standard_plan",
    "random_truth": "volid.virtual.random_truth:random_truth",
    "Truth": "volid.virtual.truth:Truth",
    "simulate": "volid.virtual.simulate:simulate",
    # identification
    "fit": "volid.fitting.fit:fit",
    "CampaignStream": "volid.io.campaign.stream:CampaignStream",
    "fit_streamed": "volid.fitting.streamed:fit_streamed",
    "parse_datum": "volid.fitting.datum:parse_datum",
    "Solution": "volid.fitting.solution:Solution",
    "save_solution": "volid.io.solutions:write_solution",
    "load_solution": "volid.io.solutions:read_solution",
    "summary": "volid.report.text.summary:summary",
    "location_errors": "volid.fitting.location_errors:location_errors",
    "LocationError": "volid.fitting.location_errors:LocationError",
    "location_parameter": "volid.fitting.location_errors:location_parameter",
    "who_determines": "volid.fitting.mixed.who:who_determines",
    "WhoDetermines": "volid.fitting.mixed.who:WhoDetermines",
    "monte_carlo": "volid.uncertainty.trials.monte_carlo:monte_carlo",
    # by a standard alone
    "evaluate": "volid.io.evaluations.evaluate:evaluate",
    "Evaluation": "volid.standards.results:Evaluation",
    # the solution under test
    "validate": "volid.validation.readings.validation:validate",
    "Validation": "volid.validation.readings.validation:Validation",
    # compensation
    "linear_grid": "volid.compensation.grids.linear:linear_grid",
    "Grid": "volid.compensation.grids.grid:Grid",
    "rotary_grids": "volid.compensation.grids.rotary:rotary_grids",
    "RotaryGrid": "volid.compensation.grids.grid:RotaryGrid",
    "save_grid": "volid.io.grids:save_grid",
    "load_grid": "volid.io.grid_reader:read_grid",
    "COMPENSATION_TYPES": "volid.compensation.types:TYPES",
    "compensation_base": "volid.compensation.base:base_of",
    "compensate": "volid.compensation.package:compensate",
    "Compensation": "volid.compensation.package:Compensation",
    "error_tables": "volid.compensation.tables.by_function:error_tables",
    "ErrorTable": "volid.compensation.tables.error_table:ErrorTable",
    "load_table": "volid.io.table_reader:read_table",
    "save_compensation": "volid.io.compensations:save_compensation",
    "compensation_files": "volid.io.compensation_files:compensation_files",
    "compensation_from_files": "volid.io.compensation_files:compensation_from_files",
    "load_control": "volid.io.compensations:load_control",
    "load_compensation": "volid.io.control_files:load_compensation",
    "recorded_compensations": "volid.io.control_files:recorded_compensations",
    "ExistingCompensation": "volid.controllers.existing.reading:ExistingCompensation",
    "Control": "volid.compensation.control:Control",
    "export": "volid.controllers.export:export",
    "Export": "volid.controllers.export:Export",
    "save_export": "volid.io.exports:save_export",
    "CONTROLS": "volid.controllers:CONTROLS",
    "apply_to_program": "volid.controllers.programs.program:apply_to_program",
    "ProgramSetting": "volid.controllers.programs.setting:ProgramSetting",
    "CorrectedProgram": "volid.controllers.programs.program:CorrectedProgram",
    "AxisTable": "volid.compensation.tables.axis_table:AxisTable",
    "best_rigid": "volid.compensation.rigid:best_rigid",
    "volumetric_summary": "volid.compensation.residual.volume:volumetric_summary",
    "measured_field": "volid.compensation.measured.field:measured_field",
    "MeasuredField": "volid.compensation.measured.field:MeasuredField",
    "compare_field": "volid.compensation.measured.against:compare_field",
    "save_field": "volid.io.fields:save_field",
    "predict_residual": "volid.compensation.residual.volume:predict_residual",
    "forecast": "volid.compensation.residual.forecast:forecast",
    "Forecast": "volid.compensation.residual.forecast:Forecast",
    # another campaign, another day
    "compare": "volid.validation.solutions.comparison:compare",
    "Comparison": "volid.validation.solutions.comparison:Comparison",
    "compare_series": "volid.validation.solutions.series:series",
    "Series": "volid.validation.solutions.series:Series",
    "quick_check": "volid.validation.check:check",
    "Check": "volid.validation.check:Check",
    # to look at, and to hand over
    "plot": "volid.report:plot",
    "save_report": "volid.report.page.page:save_report",
    "save_workbook": "volid.report.workbook.workbook:save_workbook",
    "save_dcc": "volid.report.certificate.certificate:save_dcc",
    # what can go wrong
    "accept_unusual": "volid.backend.consent:accept_unusual",
    "VolidError": "volid.exceptions:VolidError",
    "InputError": "volid.exceptions:InputError",
    "OutputError": "volid.exceptions:OutputError",
    "NotDeterminedError": "volid.exceptions:NotDeterminedError",
}
__all__ = list(_PUBLIC)


def __getattr__(name: str) -> _Any:
    if name == "__version__":
        from importlib.metadata import version

        return version("volid")
    if name not in _PUBLIC:
        raise AttributeError(f"module 'volid' has no attribute '{name}'")
    module, _, original = _PUBLIC[name].partition(":")
    value = globals()[name] = getattr(_import_module(module), original)
    return value


def __dir__() -> list[str]:
    return [*__all__, "__version__"]
