"""A measured field in words and as plain data: how it was interpolated, and whether a kinematic model describes it."""

from __future__ import annotations

from typing import Any

import numpy as np

from volid.compensation.grids.grid import Grid
from volid.compensation.measured.against import Comparison
from volid.compensation.measured.field import MeasuredField
from volid.report.text.basics import paragraph, vector


def field_lines(field: MeasuredField, grids: list[Grid]) -> list[str]:
    """Places, frame, and for each grid its largest value and u."""
    lines = paragraph(f"{len(field.points)} measured places; frame: {field.frame}")
    for grid in grids:
        known = np.isfinite(grid.values[:, 0])
        size = np.linalg.norm(grid.values[known, :3], axis=1)
        blank = (
            f"; {int((~known).sum())} of {len(known)} nodes outside what was measured are blank"
            if not known.all()
            else ""
        )
        lines += paragraph(
            f"tool {vector(list(grid.tool))} mm: largest deviation {1e3 * size.max(initial=0.0):.2f} µm, largest u "
            f"{1e3 * grid.u[known, :3].max(initial=0.0):.2f} µm{blank}; rotations are blank: for this tool vector only"
        )
    return lines


def comparison_lines(found: Comparison) -> list[str]:
    """The verdict, the numbers behind it, and the regions."""
    same = ", fitted to the same readings" if found.same_readings else ""
    of = f"tool {vector(list(found.tool))} mm{same}: {len(found.positions)} places"
    lines = paragraph(
        f"{found.verdict[:1].upper()}{found.verdict[1:]} ({of}, RMS difference {1e3 * found.rms:.2f} µm, chi-square "
        f"{found.chi_square:.0f} for {found.degrees_of_freedom:.0f} degrees of freedom, probability {found.probability:.2g})."
    )
    if found.left_out:
        lines += paragraph(f"{found.left_out} places outside what the solution was measured over are left out.")
    for r in found.regions:
        box = ", ".join(f"{a} {r.low[a]:.5g} … {r.high[a]:.5g}" for a in r.low)
        shift = ", ".join(f"{1e3 * v:+.2f} ± {2e3 * u:.2f}" for v, u in zip(r.shift, r.u, strict=True))
        lines += paragraph(f"{box} ({r.places} places): X, Y, Z {shift} µm (k = 2), E_n {r.normalised:.1f}", "-", 2)
    return lines


def comparison_data(found: Comparison) -> dict[str, Any]:
    """The same for JSON, mm."""
    return {
        "describes": found.describes,
        "verdict": found.verdict,
        "tool": list(found.tool),
        "places": len(found.positions),
        "left_out": found.left_out,
        "rms": found.rms,
        "chi_square": found.chi_square,
        "degrees_of_freedom": found.degrees_of_freedom,
        "probability": found.probability,
        "factor": found.factor,
        "same_readings": found.same_readings,
        "regions": [r._asdict() for r in found.regions],
    }
