"""The public names for type checkers. `_PUBLIC` in `__init__.py` says the same to Python; a test compares the two."""

from volid.backend.consent import accept_unusual
from volid.campaign import ActiveFiles, Alignment, Campaign, End, Environment, Expansion, ObservationSet, Station
from volid.compensation.base import base_of as compensation_base
from volid.compensation.control import Control
from volid.compensation.grids.grid import Grid, RotaryGrid
from volid.compensation.grids.linear import linear_grid
from volid.compensation.grids.rotary import rotary_grids
from volid.compensation.measured.against import compare_field
from volid.compensation.measured.field import MeasuredField, measured_field
from volid.compensation.package import Compensation, compensate
from volid.compensation.residual.forecast import Forecast, forecast
from volid.compensation.residual.volume import predict_residual, volumetric_summary
from volid.compensation.rigid import best_rigid
from volid.compensation.tables.axis_table import AxisTable
from volid.compensation.tables.by_function import error_tables
from volid.compensation.tables.error_table import ErrorTable
from volid.compensation.types import TYPES as COMPENSATION_TYPES
from volid.controllers import CONTROLS
from volid.controllers.existing.reading import ExistingCompensation
from volid.controllers.export import Export, export
from volid.controllers.programs.program import CorrectedProgram, apply_to_program
from volid.controllers.programs.setting import ProgramSetting
from volid.exceptions import InputError, NotDeterminedError, OutputError, VolidError
from volid.fitting.datum import parse_datum
from volid.fitting.fit import fit
from volid.fitting.location_errors import LocationError, location_errors, location_parameter
from volid.fitting.mixed.who import WhoDetermines, who_determines
from volid.fitting.repeatability import repeatability
from volid.fitting.solution import Solution
from volid.fitting.streamed import fit_streamed
from volid.io import load_campaign
from volid.io import read_machine as load_machine
from volid.io import write_campaign as save_campaign
from volid.io.campaign.stream import CampaignStream
from volid.io.compensation_files import compensation_files, compensation_from_files
from volid.io.compensations import load_control, save_compensation
from volid.io.control_files import load_compensation, recorded_compensations
from volid.io.evaluations.evaluate import evaluate
from volid.io.exports import save_export
from volid.io.fields import save_field
from volid.io.grid_reader import read_grid as load_grid
from volid.io.grids import save_grid
from volid.io.solutions import read_solution as load_solution
from volid.io.solutions import write_solution as save_solution
from volid.io.table_reader import read_table as load_table
from volid.model.machine import Datum, Machine
from volid.planning.standard import standard_plan
from volid.plausibility.checks import check_campaign, closures
from volid.report import plot as plot
from volid.report.certificate.certificate import save_dcc
from volid.report.page.page import save_report
from volid.report.text.summary import summary
from volid.report.workbook.workbook import save_workbook
from volid.standards.results import Evaluation
from volid.uncertainty.trials.monte_carlo import monte_carlo
from volid.validation.check import Check
from volid.validation.check import check as quick_check
from volid.validation.readings.validation import Validation, validate
from volid.validation.solutions.comparison import Comparison, compare
from volid.validation.solutions.series import Series
from volid.validation.solutions.series import series as compare_series
from volid.virtual.random_truth import random_truth
from volid.virtual.simulate import simulate
from volid.virtual.truth import Truth

__all__ = [  # noqa: RUF022
    "load_machine",
    "Machine",
    "Datum",
    "load_campaign",
    "save_campaign",
    "Campaign",
    "Station",
    "Alignment",
    "Environment",
    "Expansion",
    "ObservationSet",
    "ActiveFiles",
    "End",
    "check_campaign",
    "closures",
    "repeatability",
    "standard_plan",
    "random_truth",
    "Truth",
    "simulate",
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
    "location_parameter",
    "who_determines",
    "WhoDetermines",
    "monte_carlo",
    "evaluate",
    "Evaluation",
    "validate",
    "Validation",
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
    "compensation_files",
    "compensation_from_files",
    "load_control",
    "load_compensation",
    "recorded_compensations",
    "ExistingCompensation",
    "Control",
    "export",
    "Export",
    "save_export",
    "CONTROLS",
    "apply_to_program",
    "ProgramSetting",
    "CorrectedProgram",
    "AxisTable",
    "best_rigid",
    "volumetric_summary",
    "measured_field",
    "MeasuredField",
    "compare_field",
    "save_field",
    "predict_residual",
    "forecast",
    "Forecast",
    "compare",
    "Comparison",
    "compare_series",
    "Series",
    "quick_check",
    "Check",
    "plot",
    "save_report",
    "save_workbook",
    "save_dcc",
    "accept_unusual",
    "VolidError",
    "InputError",
    "OutputError",
    "NotDeterminedError",
]
__version__: str
