"""Laser, levels, straightedge and square on the exact machine: places from a plan's files, readings written beside them.

Each instrument is computed as it works: a level compares its body with gravity, a gauge moves along its own axis until it
touches the surface of an artefact that stands turned, with an angle and a form of its own. Everything unknown of an instrument is
drawn here.
"""

import csv
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from exact_chain.machine import ExactMachine
from exact_chain.motions import LINEAR, ROTARY
from exact_chain.truth import Truth

ZERO = {"mm": 5.0, "rad": 2e-3}  # of a laser, a gauge and a level before they are set to zero
EDGE_SLOPE = {"mm": 1e-4, "rad": 1e-7}  # per mm
TILT, LEAN = 3e-3, 5e-4  # rad: an artefact off its nominal directions, in the plane that is read and out of it
BED = 2e-5  # rad: the whole machine on its ground, from one reading to the next


@dataclass
class Instruments:
    """What is true of the instruments, drawn on first use, by names of set, line and artefact. `form`: amplitude [mm]."""

    rng: np.random.Generator
    angle_u: float = 2e-6
    form: float = 5e-4
    drawn: dict = field(default_factory=dict)

    def number(self, key: tuple, size: float) -> float:
        """One number between -size and size for a key."""
        return float(self.vector(key, size, 1)[0])

    def vector(self, key: tuple, size: float, n: int = 3) -> np.ndarray:
        """`n` numbers between -size and size for a key."""
        if key not in self.drawn:
            self.drawn[key] = self.rng.uniform(-size, size, n)
        return self.drawn[key]

    def placement(self, name: str, seen=None) -> np.ndarray:
        """How an artefact stands turned, (3, 3); `seen` (3,): the direction about which its lines show a turn."""
        if ("placement", name) not in self.drawn:
            lean = self.rng.uniform(-LEAN, LEAN, 3)
            self.drawn["placement", name] = lean + seen * (self.rng.uniform(-TILT, TILT) - lean @ seen)
        return Rotation.from_rotvec(self.drawn["placement", name]).as_matrix()

    def surface_form(self, artefact: str, line: str, s: np.ndarray) -> np.ndarray:
        """Height of an artefact's surface over its least-squares line at places s (m,) [mm]; three waves in 700 mm.

        The line, between which and another one the artefact's angle is calibrated, is that of the part first read.
        """
        phase = self.vector(("form", artefact, line), np.pi, 3)

        def waves(at):
            return self.form * sum(np.sin(2 * np.pi * k * at / 700.0 + phase[k - 1]) for k in (1, 2, 3)) / np.sqrt(1.5)

        if ("line", artefact, line) not in self.drawn:
            dense = np.linspace(s.min(), s.max(), 400)
            self.drawn["line", artefact, line] = np.polyfit(dense, waves(dense), 1)
        return waves(s) - np.polyval(self.drawn["line", artefact, line], s)


@dataclass(frozen=True)
class Rows:
    """Rows of a set: positions and directions in machine axis order, tools (m, 3), labels."""

    q: np.ndarray
    direction: np.ndarray
    tool: np.ndarray
    labels: Mapping[str, np.ndarray]

    def of(self, label: str, value) -> np.ndarray:
        return self.labels[label] == value


@dataclass(frozen=True)
class Virtual:
    """A machine, its errors, and its instruments."""

    machine: ExactMachine
    truth: Truth
    instruments: Instruments

    def components(self, name: str, rows: Rows, options: Mapping) -> np.ndarray:
        """Readings along no artefact: component of the deviation + zero, + slope of what is not aligned."""
        deviation = self.machine.deviation(rows.q, rows.tool, self.truth, rows.direction)
        values = np.zeros(len(rows.q))
        for i, (c, line, run) in enumerate(zip(*(rows.labels[k] for k in ("component", "line", "run")), strict=True)):
            unit = "mm" if c in LINEAR else "rad"
            key = (name, line, c) + ((run,) if options.get("offset_per") == "run" else ())
            values[i] = deviation[i, (LINEAR + ROTARY).index(c)] + self.instruments.number(
                ("zero", *key), ZERO[unit] / 10
            )
            if options.get("slope"):
                along = rows.of("line", line) & rows.of("component", c)
                moving = int(np.argmax(np.ptp(rows.q[along], axis=0)))
                slope = self.instruments.number(("slope", name, line, c), EDGE_SLOPE[unit])
                values[i] += slope * (rows.q[i, moving] - rows.q[along][0, moving])
        return values

    def surfaces(self, name: str, rows: Rows, options: Mapping, alignments: Mapping) -> np.ndarray:
        """Readings of a gauge on an artefact that stands on the table."""
        alignment = alignments[options["alignment"]]
        artefact = alignment.get("artefact") or alignment["name"]
        one = next(iter(options["lines"].values()))
        turn = self.instruments.placement(alignment["name"], np.cross(one["along"], one["normal"]))
        actual = self.machine.functional_point(rows.q, rows.tool, self.truth, rows.direction)
        nominal = self.machine.functional_point(rows.q, rows.tool)
        first, values = next(iter(options["lines"])), np.zeros(len(rows.q))
        for line in np.unique(rows.labels["line"]):
            here = rows.of("line", line)
            along, normal = (np.array(options["lines"][line][k], float) for k in ("along", "normal"))
            delta = (
                self.instruments.number(("angle", artefact, line), 1.7 * self.instruments.angle_u)
                if line != first and options.get("angle_u")
                else 0.0
            )
            a = turn @ Rotation.from_rotvec(delta * np.cross(along, normal)).apply(along)
            n = turn @ Rotation.from_rotvec(delta * np.cross(along, normal)).apply(normal)
            (component,) = set(rows.labels["component"][here])
            read = np.eye(3)[LINEAR.index(component)]
            start = nominal[here][np.argmin(nominal[here] @ along)]
            form = (
                (lambda s, line=line: self.instruments.surface_form(artefact, line, s)) if options.get("form_u") else 0
            )
            touched = _until_it_touches(actual[here] - start, read, (a, n), form)
            straight = (nominal[here] - start) @ normal / (read @ normal)
            zero = [
                self.instruments.number(
                    ("zero", name, line, component) + ((run,) if options.get("offset_per") == "run" else ()), 0.5
                )
                for run in rows.labels["run"][here]
            ]
            values[here] = touched - straight + zero
        return values

    def levels(self, name: str, rows: Rows, options: Mapping, alignments: Mapping) -> tuple[np.ndarray, np.ndarray]:
        """Readings of the moving and the reference level."""
        vertical = np.eye(3)[LINEAR.index(options["vertical"])]
        sway = self.instruments.rng.uniform(-BED, BED, (len(rows.q), 3))
        down = Rotation.from_rotvec(sway).apply(-vertical)  # in the frame of the bed
        bodies = [self._moving(rows, options, alignments), options.get("reference_on")]
        found = []
        for which in range(2):
            values = np.zeros(len(rows.q))
            for i in range(len(rows.q)):
                moving = bodies[0][i]
                body = moving if which == 0 else (bodies[1] or self._other_end(moving))
                turned = self._from_bed(body, rows, i)
                if which == 0 and rows.labels["placement"][i] != "machine":
                    turned = turned @ self.instruments.placement(rows.labels["placement"][i])
                # gravity as the body sees it is -v + ω × v; the horizontal part of ω is v × that
                seen = np.cross(vertical, turned.T @ down[i])
                component = rows.labels["component"][i]
                key = ("zero", name, rows.labels["line"][i], component, which)
                values[i] = seen[ROTARY.index(component)] + self.instruments.number(key, ZERO["rad"] / 4)
            found.append(values)
        return found[0], found[1]

    def _from_bed(self, body: str, rows: Rows, i: int) -> np.ndarray:
        """Rotation of a body in the frame of the bed, of machines without rotary axes (3, 3)."""
        at = rows.q[i : i + 1], self.truth, rows.direction[i : i + 1]
        bed = self.machine.body_pose("bed", *at)[0, :3, :3]
        own = self.machine.pose(*at) if body == "tool" else self.machine.body_pose(body, *at)
        return bed.T @ own[0, :3, :3]

    def _moving(self, rows: Rows, options: Mapping, alignments: Mapping) -> list[str]:
        """Body of the moving level, row by row: as stated, the artefact's, or on the side that moves along the line."""
        found = []
        for i, placement in enumerate(rows.labels["placement"]):
            if placement != "machine":
                found.append(alignments[placement].get("body", "workpiece"))
            elif options.get("moving_on"):
                found.append(options["moving_on"])
            else:
                line = rows.of("line", rows.labels["line"][i]) & rows.of("component", rows.labels["component"][i])
                moving = self.machine.axes[int(np.argmax(np.ptp(rows.q[line], axis=0)))]
                found.append("workpiece" if self.machine.primed[moving] else "tool")
        return found

    def _other_end(self, body: str) -> str:
        on_table = body == "workpiece" or self.machine.primed.get(body, False)
        return "tool" if on_table else "workpiece"


def _until_it_touches(from_start: np.ndarray, read: np.ndarray, directions: tuple, form) -> np.ndarray:
    """λ with (f - λ e - p0)·n = ε((f - λ e - p0)·a): the gauge's travel (m,) from the surface to the functional point."""
    along, normal = directions
    travel = from_start @ normal / (read @ normal)
    for _ in range(4 if form else 0):
        touched = from_start - travel[:, None] * read
        travel = (from_start @ normal - form(touched @ along)) / (read @ normal)
    return travel


def measure(folder, virtual: Virtual, noise: np.random.Generator | None) -> Path:
    """Write the readings of all sets of a plan into its CSV files, with `noise` of the stated u or none; the manifest's path."""
    folder, machine = Path(folder), virtual.machine
    manifest = tomllib.loads((folder / "campaign.toml").read_text(encoding="utf-8"))
    alignments = {a["name"]: a for a in manifest.get("alignment", [])}
    for options in manifest["set"]:
        header, cells = _read(folder / options["file"])
        rows = _rows(machine, cells, options)
        if "vertical" in options:
            columns = dict(
                zip(("moving", "reference"), virtual.levels(options["name"], rows, options, alignments), strict=True)
            )
            u = float(options["u"]) / np.sqrt(2.0)  # stated of the difference
        else:
            aligned = "alignment" in options
            read = virtual.surfaces if aligned else virtual.components
            more = (alignments,) if aligned else ()
            columns, u = {"value": read(options["name"], rows, options, *more)}, float(options["u"])
        given = [h for h in header if h not in ("value", "moving", "reference")]
        noises = {k: noise.normal(0.0, u, len(v)) if noise else 0.0 for k, v in columns.items()}
        _write(folder / options["file"], {h: cells[h] for h in given}, {k: v + noises[k] for k, v in columns.items()})
    return folder / "campaign.toml"


def _read(path: Path) -> tuple[list[str], dict[str, list[str]]]:
    with path.open(encoding="utf-8", newline="") as file:
        header, *rows = list(csv.reader(file))
    return header, {h: [row[i] for row in rows] for i, h in enumerate(header)}


def _rows(machine: ExactMachine, cells: Mapping[str, list[str]], options: Mapping) -> Rows:
    m = len(cells[machine.axes[0]])

    def numbers(name: str, default: float = 0.0) -> np.ndarray:
        return np.array(cells[name], float) if name in cells else np.full(m, default)

    q = np.stack([numbers(a) for a in machine.axes], axis=1)
    direction = np.stack([numbers(f"{a}_dir") for a in machine.axes], axis=1)
    stated = options.get("tool", [0.0, 0.0, 0.0])
    tool = np.stack([numbers(f"tool_{c}", stated[i]) for i, c in enumerate("xyz")], axis=1)
    defaults = {"line": "1", "run": "1", "placement": "machine"}
    labels = {k: np.array(cells.get(k, [defaults.get(k, "")] * m)) for k in ("component", *defaults)}
    return Rows(q, direction, tool, labels)


def _write(path: Path, given: Mapping[str, list[str]], found: Mapping[str, np.ndarray]) -> None:
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow([*given, *found])
        # a tenth of a nanometre, and of a nanoradian
        columns = [*given.values(), *([f"{v:.7f}" if abs(v) >= 1 else f"{v:.10f}" for v in f] for f in found.values())]
        writer.writerows(zip(*columns, strict=True))
