"""Grids of a field measured point by point: the same files as other grids, with a record that names no model.

See `volid.io.grids` for both forms. The record says where the values are from, that rotations are blank, and what follows for
their use: for this tool vector only.
"""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path

from volid.campaign import Campaign
from volid.compensation.grids.grid import Grid
from volid.compensation.measured.against import Comparison
from volid.exceptions import shown
from volid.io.basics.hdf5_values import to_json
from volid.io.basics.provenance import sha256
from volid.io.functions_csv import text_output, write_csv
from volid.io.grids import FORMAT, HDF5, grid_sheet, write_grid_hdf5
from volid.io.record import COMPENSATION, ERROR, values_lines


def field_header(
    grid: Grid,
    values: str,
    campaign: Campaign,
    source: str | Path | None = None,
    command: Sequence[str] = (),
    compared: Comparison | None = None,
) -> dict[str, str]:
    """The record of a grid file of a measured field. `values`: "error" or "compensation"; `source`: the campaign's file."""
    machine, tool = campaign.machine, ", ".join(f"{v:.12g}" for v in grid.tool)
    lines = {
        "format": FORMAT,
        "type": grid.type,
        **values_lines(values),
        "applied": "the control moves X, Y, Z by d at the functional point; orientation stays as it is",
        "absolute": "absolute values, not increments",
        "reversal": "as measured: the mean of both approach directions where both were measured",
        "units": f"{', '.join(grid.axes)}, dX, dY, dZ mm; dA, dB, dC blank; u_… standard uncertainty (k = 1)",
        "tool vector": f"{tool} mm; valid for this tool vector only, because rotations were not measured",
        "frame": grid.frame,
        "limits": "; ".join(
            f"{a} {n[0]:g} … {n[-1]:g}, {len(n)} points" for a, n in zip(grid.axes, grid.nodes, strict=True)
        )
        + "; linear interpolation; cells outside the measured places are blank",
        "model": "none: measured places, interpolated (ISO/TR 16907 9.3.1)",
        "machine": f"{machine.name} [{machine.structure.strip().strip('[]')}]",
        "campaign": campaign.title,
        "conditions": to_json(campaign.conditions) if campaign.conditions else "not recorded",
    }
    if compared is not None:
        lines["kinematic model"] = compared.verdict
    if source is not None:
        lines |= {"source": shown(str(source)), "source sha256": sha256(source)}
    lines["date"] = datetime.now(UTC).isoformat(timespec="seconds")
    lines["datum"] = grid.datum
    if command:
        lines["command"] = shlex.join(command)
    return lines | {f"note {i}": note for i, note in enumerate(grid.notes, start=1)}


def save_field(
    grid: Grid, campaign: Campaign, path: str | Path, *, errors: bool = False, overwrite: bool = False
) -> None:
    """Write a grid of a measured field as HDF5 when `path` ends in .h5 or .hdf5, else as CSV.

    Args:
        grid: A grid that `MeasuredField.grid` made.
        campaign: The campaign that was measured, for the record in the file.
        path: Path of the file.
        errors: Whether error values are written instead of compensation values.
        overwrite: Whether an existing file is replaced.

    Raises:
        OutputError: `path` exists and `overwrite` is False, or it cannot be written.

    Source: ISO/TR 16907 9.3.1, 12.

    >>> import numpy as np
    >>> import volid
    >>> machine = volid.load_machine("models/wYXbZt_vertical.toml")  # axes Y, X, Z
    >>> q = np.random.default_rng(1).uniform([0, 0, -400], [400, 500, 0], (30, 3))
    >>> tool, still = np.tile([0.0, 0.0, -150.0], (30, 1)), np.zeros((30, 3))
    >>> read, labels = q[:, [1, 0, 2]] + tool, {"station": np.full(30, "T")}
    >>> points = volid.ObservationSet("tracker", "point", q, still, tool, read, still + 0.001, labels)
    >>> campaign = volid.Campaign(machine, (volid.Station("T"),), (points,))
    >>> path = getfixture("tmp_path") / "field.csv"
    >>> volid.save_field(volid.measured_field(campaign).grid(points=3), campaign, path)
    >>> grid = volid.load_grid(path)
    >>> grid.type, grid.values.shape, bool(np.isnan(grid.values[:, 3:]).all())
    ('L-VOL', (27, 6), True)
    """
    write_field(grid, field_header(grid, ERROR if errors else COMPENSATION, campaign), path, overwrite)


def write_field(grid: Grid, header: dict[str, str], path: str | Path, overwrite: bool = False) -> None:
    """The same with a record of `field_header`."""
    if Path(path).suffix.lower() in HDF5:
        write_grid_hdf5(grid, header, path, overwrite)
        return
    with text_output(path, overwrite) as stream:
        write_csv(stream, grid_sheet(grid, header))
