"""Text files damaged at random, and what volid's readers make of them: an object, or one of volid's own errors, within limits.

Every trial follows from its number: which files, which of them is damaged, and how. Some fit what they read.
"""

from __future__ import annotations

import re
import resource
import signal
import tempfile
import time
import traceback
import unicodedata
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from support.campaign_files import csv_text, volume_rows, write_files
from support.instrument_files import SAMPLES
from support.kinds import EXAMPLES
from support.places import DATASETS
from volid.exceptions import VolidError
from volid.fitting.fit import fit
from volid.io import load_campaign, write_manifest
from volid.io.basics.toml_table import format_lines
from volid.io.campaign.imported import evaluation_of
from volid.io.evaluations.diagonals import read_diagonals
from volid.io.evaluations.positioning import read_positioning
from volid.io.evaluations.positioning_conditions import read_conditions
from volid.io.evaluations.step_diagonals import read_step_diagonals
from volid.io.functions_csv import read_deviations, read_functions, read_points
from volid.io.grid_reader import read_grid
from volid.io.machines import parse_machine, read_machine
from volid.io.networks import network_from_csv
from volid.io.studies import read_study
from volid.io.table_reader import read_table
from volid.plausibility.checks import check_campaign
from volid.standards.diagonals.evaluation import evaluate_diagonals
from volid.standards.positioning.conditions import contributions_of
from volid.standards.positioning.evaluation import evaluate_positioning
from volid.standards.step_diagonals.evaluation import evaluate_step_diagonals
from volid.standards.step_diagonals.steps import step_sets

LONGEST, MOST_MEMORY = 10.0, 1 << 30  # s of the processor; bytes of the whole process
ROWS = 12  # of each set: damage is done to few lines, and read in milliseconds
NASTY = (
    *("nan", "inf", "-inf", "1e300", "-1e300", "1e-300", "1e999", "0", "-0.0", "-1", "1", "1e6", "0.001", "9" * 25),
    *("9" * 400, "9" * 5000, "1_0", "0x1F", "1,5", "1e", ".", "..", "+", "-", "", " ", "\t", "\n", "\r", "\r\n", "\n\n"),
    *(",", ",,", ";", ":", '"', '""', "'", "'''", '"""', "[", "]", "[[", "]]", "{", "}", "=", "#", "\\", "\\u0000"),
    *("\\ud800", "\x00", "\x1a", "\x1b[2J", "\x7f", "\x9b31m", "\ufeff", "\u2028", "\u202e", "ü", "µ", "\U0001f600"),
    *("x" * 3000, "[" * 500, "a." * 300, "=1+1", "@x", "true", "false", "[]", "{}", "[1]", '"auto"', "1979-05-27"),
    *("12:30:00", "X", "A", "EXX", "S1", "tool", "workpiece", "../x.csv", "/dev/zero", "/etc/passwd", "volume.csv"),
    *("campaign.toml", "[[set]]\n", "[[station]]\n", "[model]\n"),
)  # fmt: skip
NUMBERS = rb"[-+]?\d+\.?\d*(?:[eE][-+]?\d+)?"
WORDS = rb"[A-Za-z_][A-Za-z_0-9]*"


@dataclass(frozen=True)
class Original:
    """Sound files by name, and what reads them from a folder."""

    files: dict[str, bytes]
    read: Callable[[Path], Any]


@dataclass(frozen=True)
class Outcome:
    """What one damaged file led to. `result`: "read" or the class of volid's error; `fault`: what must not be, else empty."""

    number: int
    original: str
    result: str
    seconds: float
    fault: str = ""


def _files_of(folder: Path) -> dict[str, bytes]:
    return {p.name: p.read_bytes() for p in sorted(folder.iterdir()) if p.is_file()}


def _checked(folder: Path, plan: bool = False) -> Any:
    campaign = load_campaign(folder / "campaign.toml", plan=plan)
    return campaign if plan else (campaign, check_campaign(campaign))


def _fitted(folder: Path) -> Any:
    campaign, _ = _checked(folder)
    return fit(campaign) if campaign.n_readings <= 200 else None


def _as_text(name: str, folder: Path) -> Original:
    """An example of an observation kind, some rows of it; small readings have values, lengths are a plan."""
    plan = EXAMPLES[name].plan()
    sets = tuple(s.rows_of(np.arange(ROWS)) for s in plan.sets[-2:])
    small = sets[-1].kind in ("displacement", "component")
    if small:
        sets = (replace(sets[-1], readings=np.full_like(sets[-1].readings, 0.01)),)
    write_manifest(replace(plan, sets=sets), folder)
    return Original(_files_of(folder), lambda f: _checked(f, plan=not small))


@cache
def originals() -> dict[str, Original]:
    """All sound files, by a name; every one can be read."""
    found = {}
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        write_files(folder / "campaign", volume=csv_text(volume_rows(np.array([[0.0, 0.0, -500.0], [9.0, 5.0, -4.0]]))))
        found["campaign"] = Original(_files_of(folder / "campaign"), _checked)
        for name in (
            "point",
            "polar",
            "displacement",
            "component, table and head",
            "distance of a network",
            "artefact",
        ):
            found[name] = _as_text(name, folder / name.replace(" ", "_"))
        published = _files_of(DATASETS / "published_positioning")
        wanted = ("campaign.toml", "machine.toml", "X.csv", "Z.csv")
        found["fit"] = Original({name: published[name] for name in wanted}, _fitted)
    machine = found["campaign"].files["machine.toml"]
    return found | _foreign(machine) | _tables(machine) | _others(machine)


def _foreign(machine: bytes) -> dict[str, Original]:
    """A set of every format of other programs, or its table where it holds results."""
    found = {}
    for name, sample in SAMPLES.items():
        file = f"sample.{name}"
        keys = {"name": "sample", "file": file, "as": name, **sample.keys}
        manifest = "\n".join(
            [*['format = "volid-campaign/1"', 'machine = "machine.toml"', "[[set]]"], *format_lines(keys)]
        )
        files = {file: sample.text.encode(), **{name: text.encode() for name, text in sample.beside.items()}}
        if sample.kind:
            files |= {"campaign.toml": manifest.encode(), "machine.toml": machine}
            found[f"as {name}"] = Original(files, _checked)
        else:
            found[f"as {name}"] = Original(files, lambda f, file=file: evaluation_of(f / file))
    return found


def _tables(machine: bytes) -> dict[str, Original]:
    three = parse_machine(machine.decode(), "machine.toml")
    return {
        "points": Original({"p.csv": POINTS}, lambda f: read_points(f / "p.csv", three)),
        "deviations": Original({"d.csv": DEVIATIONS}, lambda f: read_deviations(f / "d.csv", three)),
        "functions": Original({"f.csv": FUNCTIONS}, lambda f: read_functions(f / "f.csv")),
        "grid": Original({"g.csv": GRID}, lambda f: read_grid(f / "g.csv")),
        "table": Original({"t.csv": TABLE}, lambda f: read_table(f / "t.csv")),
        "diagonals": Original({"d.csv": DIAGONALS}, lambda f: evaluate_diagonals(read_diagonals(f / "d.csv"))),
        "step diagonals": Original({"s.csv": STEPS}, lambda f: _separated(f / "s.csv")),
    }


def _separated(path: Path) -> Any:
    campaign = read_step_diagonals(path)
    return [evaluate_step_diagonals(s, campaign) for s in step_sets(campaign)]


def _others(machine: bytes) -> dict[str, Original]:
    return {
        "machine": Original({"machine.toml": machine + MODEL}, lambda f: read_machine(f / "machine.toml")),
        "study": Original({"study.toml": STUDY, "machine.toml": machine}, lambda f: read_study(f / "study.toml")),
        "network": Original(
            {"n.csv": NETWORK, "p.csv": COORDINATES}, lambda f: network_from_csv(f / "n.csv", f / "p.csv").adjust()
        ),
        "positioning": Original({"r.csv": RUNS, "c.toml": CONDITIONS}, _positioning),
        "positioning, wide": Original({"r.csv": WIDE_RUNS, "c.toml": CONDITIONS}, _positioning),
    }


def _positioning(folder: Path) -> Any:
    """Every axis of a table of approaches, evaluated under the conditions beside it."""
    found = []
    for runs, _ in read_positioning(folder / "r.csv"):
        conditions = read_conditions(folder / "c.toml", runs.length)
        found.append(evaluate_positioning(runs, contributions_of(conditions, runs)))
    return found


RUNS = (
    b"axis,target,direction,run,actual\nX,0,+1,1,0.001\nX,100,+1,1,100.002\nX,100,-1,1,100.004\nX,0,-1,1,0.003\n"
    b"X,0,+1,2,0.002\nX,100,+1,2,100.001\nX,100,-1,2,100.003\nX,0,-1,2,0.004\n"
)
WIDE_RUNS = "target [mm],up_1 [µm],up_2 [µm],down_1 [µm],down_2 [µm]\n0,1,2,3,4\n100,2,1,4,3\n210,4,3,5,\n".encode()
CONDITIONS = (
    b"device = { U = 0.0002, U_per_length = 5e-7 }\nmisalignment = { offset = 0.5 }\n"
    b'temperature = { u = 0.2, expansion = 11.5e-6, at = 22.0, u_expansion = 1e-6 }\ndrift = { range = 8e-4, form = "linear" }\n'
    b"setup = { u = 0.0002 }\nnoise = { u = 0.0001 }\n"
)
POINTS = b"X,Y,Z,tool_x,tool_y,tool_z,X_dir\n0,0,-100,0,0,-150,1\n500,300,-250,0,0,-150,-1\n1000,600,0,80,0,-200,0\n"
_E = "ex,ey,ez,ea,eb,ec"
DEVIATIONS = (
    f"# values: deviation\nX,Y,Z,tool_x,tool_y,tool_z,{_E},{_E.replace('e', 'u_e')},outside\n"
    f"0,0,-100,0,0,-150{',0.001' * 6}{',1e-4' * 6},0\n500,300,-250,0,0,-150{',' * 6}{',' * 6},1\n"
).encode()
FUNCTIONS = (
    b"function,axis,position,direction,value,u\nEXX,X,0.0,1,0.001,0.0001\nEXX,X,500,1,0.002,\nEC0Y,Y,,0,1e-5,1e-6\n"
)
_KEYS = "# format: volid-grid/1\n# type: L-VOL\n# values: error\n# frame: machine\n# datum: X\n# tool vector: 0, 0, -150 mm\n"
GRID = (
    _KEYS
    + "# note 1: a note\nX,Y,dX,dY,dZ,dA,dB,dC,u_dX,u_dY,u_dZ,u_dA,u_dB,u_dC,outside\n"
    + "".join(f"{x},{y}{',0.001' * 12},0\n" for y in (0, 100) for x in (0, 100, 200))
).encode()
TABLE = (
    b"# format: volid-table/1\n# type: L-POS\n# function: EXX\n# values: compensation\n# rows: absolute\n"
    b"# applied: kinematic model\n# zero: X = 0 mm\n# period: none\n# datum: primary axis X\n"
    b"# interpolation: linear; largest deviation between the points 0.0004 mm\n"
    b"X,EXX(+),EXX(-),u_EXX\n0,0,0.001,1e-4\n100,-0.01,-0.009,1e-4\n200,-0.02,-0.018,1e-4\n"
)
DIAGONALS = b"# u: 0.0005\ndiagonal,target,direction,run,deviation\n" + b"".join(
    f"{name},{target},{way},{run},{0.001 * target / 700}\n".encode()
    for name in ("PPP", "XY_NP") for run in (1, 2) for target in (0, 350, 700) for way in (1, -1)
)  # fmt: skip
STEPS = (
    b"# box: X 0 200, Y 0 150, Z -150 0\n# tool: 0, 0, -150\n# u: 0.0005\n# values: deviation\n"
    b"PPP,NPP,PNP,PPN,PPP_back\n" + b"".join(f"0.00{k},0,-0.001,0.002,0.001\n".encode() for k in range(1, 7))
)
MODEL = (
    b'\n[datum]\nprimary = "X"\nsecondary = "Y"\n[model]\ndegree = 3\nsegments = "auto"\n[model.functions]\n'
    b'EXX = { segments = 20, reversal = true }\nEAZ = { over = ["Z", "X"], segments = [6, 4] }\nEC0Y = false\n'
    b'"E*X" = "constant"\n'
)
STUDY = (
    b'format = "volid-study/1"\nmachines = ["machine.toml"]\nnoise = [1.0, 2.0]\nseeds = 3\nrobust = false\nsegments = 4\n'
    b'[truth]\nscale = 1.0\nwaviness = 1.0\n[[design]]\nname = "standard"\nn_per_station = 10\nseed = 0\n'
)
NETWORK = b"from,to,distance,u\n" + b"".join(
    f"{a},{b},{d},0.001\n".encode() for a, b, d in (("A", "B", 3.0), ("A", "C", 4.0), ("B", "C", 5.0), ("A", "D", 5.0),
    ("B", "D", 4.0), ("C", "D", 3.0))
)  # fmt: skip
COORDINATES = b"point,x,y,fixed\nA,0,0,1\nB,3,0,1\nC,0.1,4,0\nD,3,4.1,0\n"


def mutated(data: bytes, rng: np.random.Generator) -> bytes:
    """The bytes with one to three pieces of damage."""
    for _ in range(rng.integers(1, 4)):
        data = DAMAGE[rng.integers(len(DAMAGE))](data, rng)
    return data


def _place(data: bytes, rng: np.random.Generator) -> int:
    return int(rng.integers(len(data) + 1))


def _nasty(rng: np.random.Generator) -> bytes:
    return NASTY[rng.integers(len(NASTY))].encode()


def _flip(data: bytes, rng: np.random.Generator) -> bytes:
    i = _place(data[:-1], rng)
    return data[:i] + bytes([data[i] ^ (1 << int(rng.integers(8)))]) + data[i + 1 :] if data else data


def _insert(data: bytes, rng: np.random.Generator) -> bytes:
    i = _place(data, rng)
    return data[:i] + _nasty(rng) + data[i:]


def _cut(data: bytes, rng: np.random.Generator) -> bytes:
    i = _place(data, rng)
    return data[:i] + data[i + int(rng.integers(1, 30)) :]


def _end(data: bytes, rng: np.random.Generator) -> bytes:
    return data[: _place(data, rng)]


def _repeat(data: bytes, rng: np.random.Generator) -> bytes:
    i, n = _place(data, rng), int(rng.integers(1, 60))
    return data[: i + n] + data[i:]


def _replace_match(pattern: bytes) -> Callable[[bytes, np.random.Generator], bytes]:
    def change(data: bytes, rng: np.random.Generator) -> bytes:
        found = list(re.finditer(pattern, data))
        if not found:
            return data
        one, other = found[rng.integers(len(found))], found[rng.integers(len(found))]
        return data[: one.start()] + (_nasty(rng) if rng.random() < 0.5 else other.group()) + data[one.end() :]

    return change


def _other_number(data: bytes, rng: np.random.Generator) -> bytes:
    """A number that could be one: of another size, or sign, or a little off."""
    found = list(re.finditer(NUMBERS, data))
    if not found:
        return data
    one = found[rng.integers(len(found))]
    factor = float(rng.choice([-1.0, 0.0, 0.001, 0.1, 0.999, 1.5, 10.0, 1e3, 1e6, 1e12]))
    return data[: one.start()] + f"{factor * float(one.group()):.9g}".encode() + data[one.end() :]


def _lines(data: bytes, rng: np.random.Generator) -> bytes:
    """A line left out, repeated, or exchanged with another."""
    lines = data.split(b"\n")
    i, j = rng.integers(len(lines), size=2)
    what = rng.integers(3)
    if what == 0:
        del lines[i]
    elif what == 1:
        lines.insert(j, lines[i])
    else:
        lines[i], lines[j] = lines[j], lines[i]
    return b"\n".join(lines)


_NUMBER, _WORD = _replace_match(NUMBERS), _replace_match(WORDS)
DAMAGE = (
    _flip,
    _flip,
    _insert,
    _cut,
    _end,
    _repeat,
    _NUMBER,
    _NUMBER,
    _other_number,
    _other_number,
    _other_number,
    _WORD,
    _lines,
)


def trial(number: int) -> Outcome:
    """One damaged set of files, read."""
    rng = np.random.default_rng(number)
    names = list(originals())
    name = names[number % len(names)]
    files = dict(originals()[name].files)
    hit = list(files)[rng.integers(len(files))]
    files[hit] = mutated(files[hit], rng)
    with tempfile.TemporaryDirectory() as place:
        for file, data in files.items():
            (Path(place) / file).write_bytes(data)
        return _read(number, name, Path(place))


def _read(number: int, name: str, folder: Path) -> Outcome:
    began, result, fault = time.process_time(), "read", ""
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024
    try:
        with _limited(), warnings.catch_warnings():
            warnings.simplefilter("ignore")
            originals()[name].read(folder)
    except VolidError as error:
        result = type(error).__name__
        fault = f"unprintable message {error!r}" if _unprintable(str(error)) else ""
    except BaseException as error:
        result, fault = type(error).__name__, traceback.format_exc()
        if isinstance(error, KeyboardInterrupt):
            raise
    seconds = time.process_time() - began
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024
    if memory > max(MOST_MEMORY, before):
        fault += f"\n{memory / 1e9:.1f} GB of memory"
    return Outcome(number, name, result, seconds, fault)


def _unprintable(text: str) -> bool:
    return any(
        unicodedata.category(c) in ("Cc", "Cf", "Cs", "Zl", "Zp") for c in text.replace("\n", "").replace("\t", "")
    )


class TooLong(BaseException):
    """Above the time that a reading may take; not an Exception, so that nothing on the way takes it for one."""


@contextmanager
def _limited() -> Iterator[None]:
    """Stops what takes longer, of the processor or, where nothing is computed, of the clock: other work may be going on."""

    def stop(signum: int, frame: Any) -> None:
        raise TooLong

    limits = ((signal.SIGPROF, signal.ITIMER_PROF, LONGEST), (signal.SIGALRM, signal.ITIMER_REAL, 6.0 * LONGEST))
    before = [signal.signal(number, stop) for number, _, _ in limits]
    for _, timer, seconds in limits:
        signal.setitimer(timer, seconds)
    try:
        yield
    finally:
        for (number, timer, _), old in zip(limits, before, strict=True):
            signal.setitimer(timer, 0.0)
            signal.signal(number, old)
