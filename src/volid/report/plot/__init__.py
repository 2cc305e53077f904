"""Figures with matplotlib, for papers, reports and notebooks: `volid.plot`.

Every function returns a `matplotlib.figure.Figure`, which a notebook shows and `savefig` writes as SVG, PDF or PNG. Lengths are
in µm, rotations in µrad, positions in mm or degrees, bands are U with k = 2. matplotlib is imported when something is drawn.

>>> import volid
>>> "error_functions" in dir(volid.plot)
True
"""

from importlib import import_module as _import_module
from typing import Any as _Any

_FIGURES = {  # name: module of this folder
    "error_functions": "functions",
    "machine_figure": "machine.drawing",
    "squareness_figure": "squareness",
    "cross_effects": "functions",
    "location_errors": "locations",
    "volume_sections": "sections",
    "deviation_volume": "field",
    "campaign_view": "scene",
    "residual_plot": "residuals",
    "angle_map": "rotary",
    "rotary_grid": "rotary",
    "residuals_by_position": "residuals",
    "residuals_by_region": "residual_regions",
    "station_geometry": "stations",
    "uncertainty_sections": "uncertainty_map",
    "correlation_matrix": "correlation",
    "budget_bars": "budget",
    "coverage_bands": "coverage",
    "volume_distribution": "coverage",
    "forecast_figure": "forecast",
    "existing_figure": "existing",
    "program_figure": "program",
    "validation_figure": "validation",
    "changes_figure": "comparison",
    "series_figure": "comparison",
    "polar_plot": "standards.circular",
    "positioning_figure": "standards.positioning",
    "diagonals_figure": "standards.diagonals",
    "nine_figure": "standards.step_diagonals",
}
__all__ = list(_FIGURES)


def __getattr__(name: str) -> _Any:
    if name not in _FIGURES:
        raise AttributeError(f"module 'volid.plot' has no attribute '{name}'")
    found = globals()[name] = getattr(_import_module(f"{__name__}.{_FIGURES[name]}"), name)
    return found


def __dir__() -> list[str]:
    return __all__
