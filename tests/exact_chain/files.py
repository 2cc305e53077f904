"""Machine and campaign as the text files that volid reads, written without it."""

import json
from pathlib import Path

import numpy as np

from exact_chain.machine import ExactMachine
from exact_chain.motions import ROTARY, unit
from exact_chain.tracker import TrackerCampaign


def machine_toml(machine: ExactMachine, name: str = "virtual machine", extra: str = "") -> str:
    """Text of the machine file, `extra` appended: [datum], [model], ..."""
    lines = ['format = "volid-machine/1"', f"name = {json.dumps(name)}", f"structure = {json.dumps(machine.structure)}"]
    for axis in machine.axes:
        lines += ["", f"[axis.{axis}]", f"travel = {_numbers(machine.travel[axis])}"]
        lines.append(f"reference = {machine.reference[axis]!r}")
        if axis in ROTARY:
            lines.append(f"point = {_numbers(machine.point[axis])}")
            if not np.array_equal(machine.direction[axis], unit(axis)):
                lines.append(f"direction = {_numbers(machine.direction[axis])}")
            if axis in machine.inclined:
                lines.append('axis_frame = "axis"')
        if not np.array_equal(machine.error_point[axis], machine.point[axis]):
            lines.append(f"error_point = {_numbers(machine.error_point[axis])}")
    return "\n".join(lines) + "\n" + (f"\n{extra.strip()}\n" if extra.strip() else "")


def _numbers(values) -> str:
    return "[" + ", ".join(repr(float(v)) for v in values) + "]"


def write_campaign(
    folder,
    campaign: TrackerCampaign,
    machine_toml_text: str,
    title: str,
    approximate_error: float | None = None,
    rng: np.random.Generator | None = None,
) -> Path:
    """Write manifest.toml, machine.toml, volume.csv; returns the manifest's path.

    Station positions are given off by `approximate_error` (standard deviation per coordinate, mm), or left out (None).
    """
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "machine.toml").write_text(machine_toml_text, encoding="utf-8")
    rng = rng or np.random.default_rng(0)
    text = ['format = "volid-campaign/1"', 'machine = "machine.toml"', f"title = {json.dumps(title)}"]
    text += ["", "[conditions]", "ambient_temperature_C = 20.0"]
    for name, position in campaign.station_positions.items():
        text += ["", "[[station]]", f"name = {json.dumps(name)}", 'body = "workpiece"']
        if approximate_error is not None:
            text += [f"position = {_numbers(position + approximate_error * rng.standard_normal(3))}"]
    text += ["", "[[set]]", 'name = "volume"', 'kind = "distance"', 'file = "volume.csv"', "relative = true"]
    text += [f"u = {{ constant = {campaign.u_constant!r}, proportional = {campaign.u_proportional!r} }}"]
    (folder / "manifest.toml").write_text("\n".join(text) + "\n", encoding="utf-8")
    header = [*campaign.axes]
    if campaign.direction is not None:
        header += [f"{axis}_dir" for axis in campaign.axes]
    lines = [",".join([*header, "tool_x", "tool_y", "tool_z", "station", "segment", "distance"])]
    for i in range(len(campaign.q)):
        cells = [repr(float(v)) for v in campaign.q[i]]
        if campaign.direction is not None:
            cells += [str(v) for v in campaign.direction[i]]
        cells += [repr(float(v)) for v in campaign.tool[i]]
        cells += [str(campaign.station[i]), str(campaign.segment[i]), repr(float(campaign.distance[i]))]
        lines.append(",".join(cells))
    (folder / "volume.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
    return folder / "manifest.toml"
