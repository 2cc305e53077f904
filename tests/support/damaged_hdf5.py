"""Damaged files of every sort that volid reads in HDF5 and in the folders of interrupted runs, and what volid makes of them.

Every file must end as "refused" (a `VolidError`) or "right" (its contents are those of the undamaged file). "changed" is a
failure where the file has a checksum; without one, another number in the place of a number cannot be noticed.
Files are read in a process that is stopped when one file takes too long; its largest memory is measured.
"""

from __future__ import annotations

import json
import multiprocessing
import os
import re
import resource
import shutil
import traceback
from collections.abc import Iterator, Sequence
from dataclasses import fields, is_dataclass, replace
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

import volid
from support.hdf5_damage import change_bytes_of, change_entry
from support.hdf5_files import without_checksum
from support.places import DATASETS, MODELS
from volid.exceptions import VolidError
from volid.io.basics.hdf5_seal import seal
from volid.io.study_results import CampaignFolder
from volid.io.truths import load_truth, write_truth
from volid.study.campaigns import COLUMNS, Design, Study
from volid.uncertainty.trials.samples import Samples, TrialFolder

LIMIT = 10.0  # s of processor time, of the process and those that it starts
PATIENCE = 90.0  # s by the clock, on a busy machine
MEMORY = 1e9  # bytes
STATES = (
    "checksum",
    "forged",
    "plain",
)  # as written; checksum made right again; as versions without checksums wrote them
RECORD = {"seed": 1, "solution": "a"}


class Task(NamedTuple):
    """One file: what it holds, its state, whether bytes or entries are changed, and the seed of the damage."""

    content: str
    state: str
    damage: str
    seed: int


class Outcome(NamedTuple):
    """What became of a file: "refused", "right", "changed", "traceback", "hang", and in words."""

    task: Task
    how: str
    result: str
    text: str
    seconds: float


def tasks(number: int, seed: int = 0) -> list[Task]:
    """So many tasks, spread over contents, states and damages; a forged checksum goes with changed entries only."""
    contents = ("campaign", "solution", "truth", "grid", "campaign", "solution")
    ways = (("checksum", "bytes"), ("checksum", "entries"), ("forged", "entries"), ("plain", "bytes"))
    kinds = [(content, *way) for way in ways for content in contents]
    kinds += [("record", "checksum", "bytes"), ("batch", "checksum", "bytes"), ("record", "plain", "bytes")]
    return [Task(*kinds[i % len(kinds)], seed + i) for i in range(number)]


# ------------------------------------------------------------------------------------------------ undamaged files


def make_sources(folder: Path) -> None:
    """One undamaged file of every content, small ones."""
    campaign = _campaign()
    volid.save_campaign(campaign, folder / "campaign.h5")
    solution = volid.fit(campaign)
    rng = np.random.default_rng(3)
    x, m = rng.standard_normal((40, len(solution.covariance))), np.arange(40.0)
    samples = Samples(40, lambda: iter([x]), m, m, m > 3, m.astype(int), 1)
    volid.save_solution(replace(solution, samples=samples), folder / "solution.h5")
    grid = volid.linear_grid(solution, points=3, tool=tuple(campaign.sets[0].tool[0]))
    volid.save_grid(grid, solution, folder / "grid.h5")
    write_truth(volid.random_truth(campaign.machine, 3), folder / "truth.h5")
    study, task = _study()
    record = {n: {str: "a", int: 7, float: 0.25, bool: True}[k] for n, (k, _) in COLUMNS.items()}
    record |= {"error": "", "differences": {"field": [1.0, 2.0]}, "u_of": {"field": [0.5, 0.5]}}
    store = CampaignFolder(folder / "study", study, resume=True)
    store.save(task, record)
    shutil.copy(store.place(task), folder / "record.json")
    trials = TrialFolder(folder / "trials", RECORD, resume=True)
    trials.save(0, {"x": x, "chi_square": m, "error": m, "solved": m > 3, "outliers": m.astype(int)})
    shutil.copy(trials.place(0), folder / "batch.npz")


def _campaign() -> Any:
    whole = volid.load_campaign(DATASETS / "vertical_multilateration" / "campaign.toml")
    readings = whole.sets[0].rows_of(np.arange(0, len(whole.sets[0]), 6))
    m = len(readings)
    machine = replace(whole.machine, model=replace(whole.machine.model, segments=2), text="")
    recorded = replace(readings, time=np.arange(1.0 * m), temperature=np.full(m, 20.5))
    return replace(
        whole, machine=machine, sets=(recorded,), conditions={"room": {"temperature": [20.0, 20.5]}}, warnings=("w",)
    )


def _study() -> Any:
    study = Study({"m": volid.load_machine(MODELS / "wYXbZt_vertical.toml")}, (Design("standard"),), seeds=(1,))
    return study, study.tasks[0]


# ------------------------------------------------------------------------------------------------ one damaged file


def damaged(task: Task, sources: Path, folder: Path) -> tuple[Path, str]:
    """The damaged file of a task, and how it was damaged."""
    (source,) = sources.glob(f"{task.content}.*")
    path = folder / source.name
    path.unlink(missing_ok=True)
    shutil.copy(source, path)
    rng = np.random.default_rng(task.seed)
    if task.state == "plain" and task.content == "record":
        path.write_text(json.dumps({k: v for k, v in json.loads(path.read_text()).items() if k != "sha256"}))
    elif task.state == "plain":
        without_checksum(path)
    how = (change_bytes_of if task.damage == "bytes" else change_entry)(path, rng)
    if task.state == "forged":
        with path.open("r+b") as file:
            seal(file)
    return path, how


def read(content: str, path: Path, use: bool = True) -> Any:
    """What a file holds, read and used a little, as plain values that can be compared; None where it is to be made again."""
    if content == "record":
        study, task = _study()
        store = CampaignFolder(path.parent / "study", study, resume=True)
        shutil.copy(path, store.place(task))
        return store.done().get(task)
    if content == "batch":
        trials = TrialFolder(path.parent / "trials", RECORD, resume=True)
        trials._begin()
        shutil.copy(path, trials.place(0))
        return plain(trials.load(0)) if trials.done(0) else None
    found = {
        "campaign": volid.load_campaign, "solution": volid.load_solution, "truth": load_truth, "grid": volid.load_grid,
    }[content](path)  # fmt: skip
    if use:
        _use(content, found, path)
    return plain(found)


def _use(content: str, found: Any, path: Path) -> None:
    if content == "campaign":
        volid.check_campaign(found)
        list(volid.CampaignStream(path).parts(rows=150))
    elif content == "solution":
        volid.summary(found)
        found.evaluate(found.campaign.positions[:2], found.campaign.sets[0].tool[:2])
    elif content == "truth":
        found.deviation([sum(axis.travel) / 2 for axis in found.machine.axes], (0.0, 0.0, -100.0))


def plain(value: Any) -> Any:
    """Numbers, texts and lists in the place of every object, for comparison; files may stand elsewhere."""
    if isinstance(value, Samples):
        return plain(
            {f.name: getattr(value, f.name) for f in fields(value) if f.name != "batches"} | {"x": [*value.batches()]}
        )
    if is_dataclass(value):
        return [
            type(value).__name__,
            {f.name: plain(getattr(value, f.name)) for f in fields(value) if f.name != "source"},
        ]
    if isinstance(value, dict) or hasattr(value, "items"):
        return {str(k): plain(v) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [plain(v) for v in value]
    if hasattr(value, "dtype") and hasattr(value, "tobytes"):
        return [str(value.dtype), value.shape, np.asarray(value).tobytes()]
    return repr(value)


def judge(task: Task, sources: Path, folder: Path, right: dict[str, Any]) -> Outcome:
    """Damage a file, read it, and say what came of it."""
    path, how = damaged(task, sources, folder)
    begin = sum(os.times()[:4])
    try:
        found = read(task.content, path)
        result = "refused" if found is None else "right" if found == right[task.content] else "changed"
        text = ""
    except VolidError as error:
        result, text = "refused", str(error)
    except BaseException:
        result, text = "traceback", traceback.format_exc()
    seconds = sum(os.times()[:4]) - begin
    return Outcome(task, how, result if seconds < LIMIT else "hang", text, seconds)


# ------------------------------------------------------------------------------------------------ many, in a process


def _work(pipe: Connection, sources: Path, folder: Path) -> None:
    folder.mkdir(exist_ok=True)
    right = {}
    for content in ("campaign", "solution", "truth", "grid", "record", "batch"):
        (source,) = sources.glob(f"{content}.*")
        right[content] = read(content, Path(shutil.copy(source, folder)))
    pipe.send("ready")
    while (task := pipe.recv()) is not None:
        pipe.send(judge(task, sources, folder, right))
    pipe.send(memory())


def memory() -> float:
    """Largest memory of this process or one that it started [bytes].

    Linux counts what the parent had when it started this process as part of its `ru_maxrss`, but not of its own high-water mark.
    """
    status = Path("/proc/self/status")
    found = re.search(r"VmHWM:\s*(\d+) kB", status.read_text()) if status.exists() else None
    own = int(found[1]) if found else resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return 1024.0 * max(own, resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss)


def run(todo: Sequence[Task], sources: Path) -> Iterator[Outcome | float]:
    """The outcome of every task, and the largest memory of every process that did some; one that hangs is replaced."""
    waiting = list(reversed(todo))
    context = multiprocessing.get_context("spawn")
    while waiting:
        pipe, theirs = context.Pipe()
        process = context.Process(target=_work, args=(theirs, sources, sources / f"work{os.getpid()}"), daemon=False)
        process.start()
        theirs.close()
        pipe.recv()
        while waiting:
            task = waiting.pop()
            pipe.send(task)
            try:
                if pipe.poll(PATIENCE):
                    yield pipe.recv()
                    continue
                yield Outcome(task, "", "hang", f"more than {PATIENCE:g} s", PATIENCE)
            except EOFError:
                yield Outcome(task, "", "crash", "its process ended", 0.0)
            process.kill()
            break
        else:
            pipe.send(None)
            yield pipe.recv()
        process.join()
