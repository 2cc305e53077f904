"""A day in a workshop, apart from the package: air that drifts, by another formula than the package's, and what an interferometer
counts in it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
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
DAY = 8 * 3600.0  # s
LAMBDA = 0.632991  # µm


def air(t):
    """Temperature [°C], pressure [hPa], humidity [%] at time t [s]: 3 K warmer in the evening, and a front that passes."""
    share = np.asarray(t) / DAY
    return 20.5 + 3.0 * share + 0.3 * np.sin(9.0 * share), 1004.0 - 9.0 * share**2, 42.0 + 6.0 * np.sin(3.0 * share)


def edlen(temperature, pressure, humidity):
    """n - 1 by the equation of Birch and Downs (Metrologia 31 (1994) 315), its vapour term times 292.75 K / T as the refractive
    index calculator of NIST's Engineering Metrology Toolbox has it (Stone and Zimmerman): that extends it beyond 20 °C."""
    p, s = 100.0 * np.asarray(pressure), LAMBDA**-2  # Pa, µm⁻²
    standard = 1e-8 * (8342.54 + 2406147.0 / (130.0 - s) + 15998.0 / (38.9 - s))
    dry = standard * p / 96095.43 * (1.0 + 1e-8 * (0.601 - 0.00972 * temperature) * p) / (1.0 + 0.0036610 * temperature)
    # saturation by the Magnus formula of Sonntag (1990), 0.1 % at room temperature
    vapour = 0.01 * humidity * 611.2 * np.exp(17.62 * temperature / (243.12 + temperature))
    return dry - vapour * 292.75 / (273.15 + temperature) * (3.7345 - 0.0401 * s) * 1e-10


def beams(campaign: TrackerCampaign):
    """Rows of every uninterrupted beam."""
    keys = list(zip(campaign.station.tolist(), campaign.segment.tolist(), strict=True))
    return [np.flatnonzero([k == key for k in keys]) for key in dict.fromkeys(keys)]


def optical(path, start_path, start_reading, n, n_start):
    """Reading in vacuum wavelengths [mm]: by how much the optical path changed since the start, plus what it read there."""
    return start_reading + n * path - n_start * start_path


def log_csv(step=300.0, end=DAY, material=None):
    """Text of a log, an entry every `step` s; `material`: function of time, its temperature [°C]."""
    times = np.arange(-step, end + 2 * step, step)
    columns = {
        "time": times,
        **dict(zip(("air_temperature_C", "pressure_hPa", "humidity_percent"), air(times), strict=True)),
    }
    if material is not None:
        columns["material_1_C"] = material(times)
    rows = [",".join(map(repr, map(float, row))) for row in zip(*columns.values(), strict=True)]
    return "\n".join([",".join(columns), *rows]) + "\n"


class Day:
    """Distances from six stations over a day. `grown(t)`: by how much the whole set-up is longer than at 20 °C, a ratio."""

    def __init__(self, seed: int = 11, grown=None, n_per_station: int = 70, u_constant: float = 0.0003) -> None:
        self.machine, rng = ExactMachine("w Y' X' b Z (C) t", TRAVEL), np.random.default_rng(seed)
        self.truth: Truth = random_truth(self.machine, rng, waviness=0.3, scale=0.3)
        self.campaign = tracker_campaign(
            self.machine, self.truth, rng, n_per_station=n_per_station, u_constant=u_constant, u_proportional=1e-7,
            every_station_sees_every_tool=True,
        )  # fmt: skip
        given, m = self.campaign, len(self.campaign.q)
        self.time = np.linspace(0.0, DAY, m)
        self.n = 1.0 + edlen(*air(self.time))
        grown = np.zeros(m) if grown is None else grown(self.time)
        stations = np.array([given.station_positions[name] for name in given.station])
        path = np.linalg.norm(self.machine.functional_point(given.q, given.tool, self.truth, None) - stations, axis=1)
        dead = np.array([given.dead_paths[k] for k in zip(given.station.tolist(), given.segment.tolist(), strict=True)])
        self.noise = given.distance - path - dead
        self.path, self.dead = path * (1.0 + grown), dead
        self.read = np.zeros(m)
        for rows in beams(given):
            first = rows[0]
            start = self.path[first] + dead[first]  # what the display was set to
            self.read[rows] = optical(self.path[rows], self.path[first], start, self.n[rows], self.n[first])
        self.read += self.noise

    def write(self, folder: Path, environment: str, log: str | None = None, readings=None) -> Path:
        """Manifest, set with times, and log; `environment`: text of the [[environment]] table. Returns the manifest."""
        text = machine_toml(self.machine, extra="[model]\nsegments = 2\n")
        self.campaign.distance = self.read if readings is None else readings
        manifest = write_campaign(folder, self.campaign, text, "a day", 3.0, np.random.default_rng(1))
        lines = (folder / "volume.csv").read_text(encoding="utf-8").splitlines()
        rows = [f"{line},{t!r}" for line, t in zip(lines[1:], self.time.tolist(), strict=True)]
        (folder / "volume.csv").write_text("\n".join([f"{lines[0]},time", *rows]) + "\n", encoding="utf-8")
        (folder / "day.csv").write_text(log_csv() if log is None else log, encoding="utf-8")
        manifest.write_text(manifest.read_text(encoding="utf-8") + environment, encoding="utf-8")
        return manifest
