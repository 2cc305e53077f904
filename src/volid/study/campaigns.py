"""Studies: many campaigns (machines × designs × noise × seeds), each simulated, fitted and compared with its truth."""

from __future__ import annotations

import hashlib
import pickle
import time
from collections.abc import Callable, Generator, Mapping
from contextlib import closing
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from volid.backend.cluster import cluster, gather
from volid.backend.consent import ask_memory
from volid.backend.processes import Died, cores, in_processes, single_threaded_environment
from volid.backend.steps import Step
from volid.campaign import Campaign, ObservationSet
from volid.exceptions import InputError, VolidError
from volid.fitting.fit import fit
from volid.model.machine import Machine
from volid.observations import KINDS
from volid.planning.standard import ask_rows, standard_plan
from volid.study.summary import FIELD, mean_of, rms_of
from volid.virtual.comparison import Comparison, compare, covered
from volid.virtual.random_truth import random_truth
from volid.virtual.simulate import on_machine, simulate

Record = dict[str, Any]
Progress = Callable[[str], None]
# What is known about a campaign, with its unit; a failed one has `error`, and NaN or False elsewhere
COLUMNS: dict[str, tuple[type, str]] = {
    "machine": (str, ""),
    "design": (str, ""),
    "noise": (float, ""),
    "seed": (int, ""),
    "readings": (int, ""),
    "parameters": (int, ""),
    "undetermined": (int, ""),
    "outliers": (int, ""),
    "unit_weight": (float, ""),
    "rejected": (bool, ""),
    "converged": (bool, ""),
    "rms": (float, "mm"),
    "largest": (float, "mm"),
    "u": (float, "mm"),
    "coverage_field": (float, ""),
    "coverage_functions": (float, ""),
    "seconds": (float, "s"),
    "error": (str, ""),
}
_EMPTY = {str: "", int: 0, float: float("nan"), bool: False}
RECORD = 4e4  # bytes of a campaign's record
DIED = "its process died twice; was there enough memory?"


@dataclass(frozen=True, eq=False)
class Design:
    """Where to measure: a plan, or without one the `standard_plan` of each machine with `n_per_station` and `seed`."""

    name: str
    plan: Campaign | None = None
    n_per_station: int = 400
    seed: int = 0

    def __post_init__(self) -> None:
        if self.plan is None:
            ask_rows(self.n_per_station, self.seed)

    def on(self, machine: Machine) -> Campaign:
        """The plan for `machine`. Raises `InputError` when a given plan has other axes."""
        if self.plan is not None:
            return on_machine(self.plan, machine)
        return standard_plan(machine, self.n_per_station, self.seed)

    @cached_property
    def fingerprint(self) -> str:
        """Hash of what is measured where."""
        stations = self.plan.stations if self.plan else ()
        digest = hashlib.sha256(repr((self.n_per_station, self.seed, stations)).encode())
        for s in self.plan.sets if self.plan else ():
            digest.update(repr((s.name, s.kind, dict(s.options), s.effects, list(s.labels))).encode())
            for a in (*s.side_by_side, s.u, s.time, s.temperature):
                digest.update(b"none" if a is None else np.ascontiguousarray(a, dtype=float).tobytes())
            for label in s.labels.values():
                digest.update(repr(np.asarray(label).tolist()).encode())
        return digest.hexdigest()


class Truths(NamedTuple):
    """The virtual machines: `scale` and `waviness` of `random_truth`; `seed`: one truth for all, None: one per campaign seed."""

    scale: float = 1.0
    waviness: float = 1.0
    seed: int | None = None


SEEDED = Truths()


class Task(NamedTuple):
    """One campaign of a study."""

    machine: str
    design: str
    noise: float
    seed: int

    def __str__(self) -> str:
        return f"machine {self.machine}, design {self.design}, noise {self.noise:g}, seed {self.seed}"


@dataclass(frozen=True, eq=False)
class Study:
    """Which campaigns: every machine with every design, noise and seed.

    `machines`: by name. `noise`: factors on the u of all readings, in the simulation and as stated to the fit; the u of
    systematic effects is not multiplied. `robust`: option of the fit. `segments`: segments of the splines, in place of `[model]
    segments` of each machine; functions with their own segments keep them.
    """

    machines: Mapping[str, Machine]
    designs: tuple[Design, ...]
    noise: tuple[float, ...] = (1.0,)
    seeds: tuple[int, ...] = tuple(range(20))
    robust: bool = False
    segments: int | str | None = None
    truths: Truths = SEEDED
    source: str = "study"

    def __post_init__(self) -> None:
        n = len(self.machines) * len(self.designs) * len(self.noise) * len(self.seeds)
        ask_memory(f"{self.source}: {n:,} campaigns", RECORD * n, "Take fewer seeds, designs or factors on the noise")

    @property
    def tasks(self) -> tuple[Task, ...]:
        """The campaigns in order: machines, designs, noise, seeds; the last changes fastest."""
        return tuple(
            Task(m, d.name, n, s) for m in self.machines for d in self.designs for n in self.noise for s in self.seeds
        )

    def machine(self, task: Task) -> Machine:
        """The machine of a campaign, with the study's segments."""
        machine = self.machines[task.machine]
        model = machine.model if self.segments is None else replace(machine.model, segments=self.segments)
        return replace(machine, model=model)

    def design(self, task: Task) -> Design:
        """The design of a campaign."""
        return next(d for d in self.designs if d.name == task.design)

    def fingerprint(self, task: Task) -> str:
        """Hash of everything a campaign's result depends on, but the version of the program."""
        given = (self.machine(task), tuple(task), self.robust, tuple(self.truths), self.design(task).fingerprint)
        return hashlib.sha256(repr(given).encode()).hexdigest()


def scaled_noise(plan: Campaign, factor: float) -> Campaign:
    """The plan with the u of every reading multiplied by `factor`; systematic effects stay as they are."""
    return replace(plan, sets=tuple(_scaled(s, factor) for s in plan.sets))


def _scaled(readings: ObservationSet, factor: float) -> ObservationSet:
    keys = ("u", *(f"u_{name}" for name in KINDS[readings.kind].readings))
    options = dict(readings.options)
    for key in keys:
        if key in options:
            u = options[key]
            options[key] = {k: factor * v for k, v in u.items()} if isinstance(u, Mapping) else factor * u
    return replace(readings, u=factor * readings.u, options=options)


def run_campaign(study: Study, task: Task) -> Record:
    """Simulate, fit and compare one campaign, in this process.

    The record has `COLUMNS`, and for `summary` the differences from the truth and their u by quantity: `differences`, `u_of`,
    lists of numbers. Whatever goes wrong is the text in `error`.
    """
    began = time.perf_counter()
    try:
        record = _record(task) | _carry_out(study, task)
    except Exception as error:  # one campaign of thousands must not end the others
        text = str(error) if isinstance(error, VolidError) else f"{type(error).__name__}: {error}"
        record = _record(task, " ".join(text.split()))
    return record | {"seconds": time.perf_counter() - began}


def _record(task: Task, error: str = "") -> Record:
    """A record that contains only the task, and the reason when it failed."""
    empty = {name: _EMPTY[kind] for name, (kind, _) in COLUMNS.items()}
    return empty | task._asdict() | {"error": error, "differences": {}, "u_of": {}}


def _carry_out(study: Study, task: Task) -> Record:
    machine, truths = study.machine(task), study.truths
    seed = task.seed if truths.seed is None else truths.seed
    truth = random_truth(machine, seed, scale=truths.scale, waviness=truths.waviness)
    plan = scaled_noise(study.design(task).on(machine), task.noise)
    campaign, truth = simulate(plan, truth, seed=task.seed)
    solution = fit(campaign, robust=study.robust)
    found = compare(solution, truth)
    return {
        "readings": solution.statistics.n_readings,
        "parameters": solution.statistics.n_parameters,
        "undetermined": solution.null_space.shape[1],
        "outliers": sum(int(o.sum()) for o in solution.readings.outliers),
        "unit_weight": solution.adequacy.unit_weight,
        "rejected": bool(solution.adequacy.rejected),
        "converged": bool(solution.statistics.converged),
        **_errors(found),
        "differences": {FIELD: found.field.ravel().tolist()} | {n: v.tolist() for n, v in found.functions.items()},
        "u_of": {FIELD: found.field_u.ravel().tolist()} | {n: v.tolist() for n, v in found.functions_u.items()},
    }


def _errors(found: Comparison) -> Record:
    """RMS and largest length of the difference of the fields, RMS length of its u [mm]; coverage of field and functions."""
    size = np.linalg.norm(found.field, axis=1)
    inside = [covered(found.functions[n], found.functions_u[n]) for n in found.functions]
    return {
        "rms": rms_of(size),
        "largest": float(np.nanmax(size)) if np.isfinite(size).any() else float("nan"),
        "u": rms_of(np.linalg.norm(found.field_u, axis=1)),
        "coverage_field": mean_of(covered(found.field, found.field_u)),
        "coverage_functions": mean_of(np.concatenate(inside) if inside else np.zeros(0)),
    }


def run_study(
    study: Study,
    *,
    workers: int | None = None,
    scheduler: str | None = None,
    done: Mapping[Task, Record] | None = None,
    save: Callable[[Task, Record], None] | None = None,
    progress: Progress | None = None,
) -> list[Record]:
    """Records of all campaigns, in the order of `study.tasks`; only `seconds` depends on where they are computed.

    `workers`: processes on this machine, one per core by default; `scheduler`: address of a Dask scheduler instead (its
    workers should have one thread each). `done`: records that are there already; `save`: called with every new one.

    Raises `InputError` for a number of workers below 1 or both ways at once, `VolidError` when the workers fail.
    """
    if workers is not None and (scheduler or workers < 1):
        wrong = "the scheduler has its own; give one of both" if scheduler else "expected at least 1"
        raise InputError(f"`workers={workers}`: {wrong}")
    records = dict(done or {})
    waiting = [task for task in study.tasks if task not in records]
    total, failed = len(study.tasks), sum(bool(record["error"]) for record in records.values())
    report = progress or (lambda message: None)
    report(_progress_of(len(records), total, failed) if records else f"{total} campaigns")
    with closing(_results(study, waiting, workers or cores(), scheduler)) as results:
        for task, record in results:
            records[task] = record
            if save is not None:
                save(task, record)
            failed += bool(record["error"])
            report(_progress_of(len(records), total, failed))
    return [records[task] for task in study.tasks]


def _progress_of(done: int, total: int, failed: int) -> str:
    return Step(done, total, "campaigns", more=f", {failed} failed" if failed else "")


def _results(
    study: Study, waiting: list[Task], workers: int, scheduler: str | None
) -> Generator[tuple[Task, Record], None, None]:
    tasks = [tuple(task) for task in waiting]
    if scheduler is None:
        for i, record in in_processes(_campaign, tasks, study, min(workers, max(len(tasks), 1))):
            yield waiting[i], _record(waiting[i], DIED) if isinstance(record, Died) else record
        return
    with cluster(scheduler) as client:
        try:
            for i, record in gather(client, _campaign_of_worker, tasks, pickle.dumps(study)):
                yield waiting[i], record
        except (GeneratorExit, KeyboardInterrupt, VolidError):
            raise
        except Exception as error:
            raise VolidError(
                f"`scheduler={scheduler}`: the cluster gave up: {error}; go on with `resume=True`"
            ) from error


_STUDIES: dict[str, Study] = {}  # of this Dask worker, the last one only


def _campaign(study: Study, *task: Any) -> Record:
    """One campaign, in a process of this machine."""
    return run_campaign(study, Task(*task))


def _campaign_of_worker(payload: bytes, *task: Any) -> Record:
    """One campaign, in a Dask worker; in a fresh one JAX and NumPy take one thread.

    A worker may be a thread of the user's own process, whose environment stays as it was.
    """
    with single_threaded_environment():
        key = hashlib.sha256(payload).hexdigest()
        if key not in _STUDIES:
            _STUDIES.clear()
            _STUDIES[key] = pickle.loads(payload)
        return run_campaign(_STUDIES[key], Task(*task))
