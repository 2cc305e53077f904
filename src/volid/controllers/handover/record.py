"""The documentation that accompanies every export (ISO/TR 16907 9.1): how the machine was measured, and what the files mean.

First the items that the standard asks for, as the campaign states them, with those that it does not state named as missing.
Then the meaning of the files: sign, absolute or incremental, kinematic chain, squareness as an angle, datum, frames, reversal,
limits, what is expected to remain, and where the numbers come from.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from volid.compensation.residual.volume import ResidualPrediction, predict_left, predict_uncompensated
from volid.controllers.export import Export
from volid.controllers.handover.explain import option_words, properties_of_files
from volid.controllers.handover.markdown import bullets, heading, table, text_of
from volid.controllers.handover.sheet import parts_of
from volid.exceptions import InputError, NotDeterminedError
from volid.fitting.solution import Solution
from volid.fitting.squareness import angle_in_words, squareness_symbol
from volid.fitting.tabulation import constant
from volid.model.axis_lines import constant_rows
from volid.model.error_functions import describe_datum
from volid.model.iso230 import LINEAR_AXES, parse
from volid.model.machine import Machine
from volid.plausibility.conditions import active_compensations
from volid.plausibility.record import IN_READINGS, ITEMS, Item
from volid.plausibility.record import record as record_of_campaign
from volid.uncertainty.lack_of_fit import verdict_words

DRAWS = 200  # of the parameters, for what is expected to remain
COVERAGE = 2.0  # U = k u
WORDS = {
    "warm_up": "condition of the machine, warm-up",
    "positions": "positions of all linear and rotary axes",
    "tool_length": "tool length of the set-up",
    "tool_offset": "tool offset",
    "load": "load",
    "feed": "feed",
    "acceleration": "acceleration",
    "ambient_temperature": "ambient temperature",
    "component_temperatures": "temperature of machine components",
    "active_compensations": "active compensations",
    "date": "date of measurement",
    "operator": "operator",
    "instrument": "instrument",
    "traceability": "traceability",
}
MISSING = "NOT STATED: add it to [conditions] of the campaign"
CONVERTED = "These files were not made from a solution: how the machine was measured is not known here."


def record_text(made: Export, origin: Mapping[str, str] | None = None, predict: bool = True) -> str:
    """The record of an export, a text with headings and tables.

    Args:
        made: The export.
        origin: Where it comes from, by name: source and its hash, version, date, command.
        predict: Whether what is expected to remain is computed; else the command for it is named.
    """
    lines = heading(f"Record: {made.declaration.title}", 1)
    if made.solution is None:
        lines += [CONVERTED]
    else:
        lines += [*heading("How the machine was measured (ISO/TR 16907 9.1)"), *_measured(made.solution)]
    lines += [*heading("What the files mean"), *table(["item", "in these files"], _meaning(made))]
    lines += [*heading("What is in them"), *bullets(parts_of(made.held))]
    if made.solution is not None:
        lines += [*heading("What the numbers refer to"), *table(["item", "value"], _reference(made.solution, made))]
        lines += [*heading("What is expected to remain"), *(_remaining(made, made.solution) if predict else [_COMMAND])]
    if made.notes:
        lines += [*heading("Notes"), *bullets(made.notes)]
    lines += [*heading("Where they come from"), *table(["item", "value"], [[k, v] for k, v in (origin or {}).items()])]
    return text_of(lines)


def carto_chain(machine: Machine) -> str:
    """The linear axes from workpiece to tool with F for the bed, as CARTO writes a chain.

    >>> import volid
    >>> carto_chain(volid.load_machine("models/wYXbZt_vertical.toml"))
    'YXFZ'
    """
    linear = [a for a in machine.axes if a.is_linear]
    carrying = "".join(a.letter for a in linear if a.primed)
    return f"{carrying}F{''.join(a.letter for a in linear if not a.primed)}"


def missing_items(solution: Solution) -> list[str]:
    """Items of ISO/TR 16907 9.1 that the campaign does not state, in words."""
    return [WORDS[i.name] for i in record_of_campaign(solution.campaign) if i.name in ITEMS and i.is_missing]


def _measured(solution: Solution) -> list[str]:
    rows = [[_name(item), _stated(solution, item)] for item in record_of_campaign(solution.campaign)]
    return table(["item", "stated"], rows)


def _name(item: Item) -> str:
    return WORDS.get(item.name, "further")


def _stated(solution: Solution, item: Item) -> str:
    texts = [f"{key}: {text or 'none'}" for key, text in item.stated]
    texts += [f"{kind} {name}" for kind, name in item.measured]
    if item.name in IN_READINGS:
        texts.append(_in_readings(solution, item.name))
    return "; ".join(texts) if texts else MISSING


def _in_readings(solution: Solution, name: str) -> str:
    """What every reading says by itself."""
    if name == "positions":
        ranges = zip(solution.machine.axes, solution.measured_range(), strict=True)
        return ", ".join(f"{a.letter} {low:g} … {high:g} {a.unit}" for a, (low, high) in ranges) + " (in every reading)"
    vectors = np.unique(np.asarray(solution.campaign.tool_vectors(), dtype=float).reshape(-1, 3), axis=0)
    some = "; ".join(", ".join(f"{v:g}" for v in t) for t in vectors[:4])
    more = f" and {len(vectors) - 4} more" if len(vectors) > 4 else ""
    return f"tool vectors {some}{more} mm (in every reading)"


def _meaning(made: Export) -> list[list[str]]:
    """How a program or a person has to read the values."""
    machine, job = made.job.machine, made.job
    chain = machine.structure.strip().strip("[]")
    lines = ", ".join(f"{a.letter} = {v:g} {a.unit}" for a, v in zip(machine.axes, job.at, strict=True))
    return [
        ["compensation types", ", ".join(made.types) or "as read from files"],
        *properties_of_files(made.declaration, job.sign, made.controller.of_these_files(job.options)),
        ["largest change by the steps of the values", _rounding(made.written.rounding)],
        ["kinematic chain, workpiece to tool", f"[{chain}]; as CARTO spells it: {carto_chain(machine)} (F: bed)"],
        ["order of the axes", ", ".join(machine.letters)],
        ["tool vector", f"{', '.join(f'{v:g}' for v in job.tool)} mm, from the tool frame to the functional point"],
        ["lines cross at", lines],
        ["frame of rotary values", _rotary_frames(machine)],
        *[[f"option {name}", option_words(value)] for name, value in job.options.items()],
    ]


def _rounding(value: float) -> str:
    return f"{value:.3g} (mm, or rad for rotations)" if value else "none beyond the digits written"


def _rotary_frames(machine: Machine) -> str:
    rotary = [a for a in machine.axes if not a.is_linear]
    frames = [f"{a.letter}: {'its own, z along its direction' if a.axis_frame else 'machine frame'}" for a in rotary]
    return "; ".join(frames) if frames else "no rotary axis"


def _reference(solution: Solution, made: Export) -> list[list[str]]:
    active = active_compensations(solution.campaign.conditions)
    state = f"on top of: {'; '.join(active)}" if active else "no compensation is stated as active while measuring"
    if made.existing is not None:
        state += "; these files hold the sum of the existing compensation and what remained with it"
    rows = [
        ["campaign", solution.campaign.title],
        ["verdict", verdict_words(solution)],
        ["state of the machine", state],
        ["datum", describe_datum(solution.machine, solution.datum)],
    ]
    return rows + [["squareness", text] for text in squareness_words(solution)]


def squareness_words(solution: Solution) -> list[str]:
    """Each squareness with U (k = 2) and which angle it makes."""
    found = []
    for row in constant_rows(solution.model):
        symbol = parse(row.name)
        if symbol.axis in LINEAR_AXES:
            value = constant(solution, row)
            if np.isfinite(value.value):
                expanded = COVERAGE * value.u
                angle = angle_in_words(row.name, value.value, expanded)
                found.append(
                    f"{squareness_symbol(row.name)} = {1e6 * value.value:.2f} µrad, U = {1e6 * expanded:.2f} µrad: {angle}"
                )
    return found


_COMMAND = (
    "Not computed here: `volid residual` with these types predicts it, with intervals, and for other tool vectors."
)


def _remaining(made: Export, solution: Solution) -> list[str]:
    """Deviation of the functional point over the working volume before and after, with these very files."""
    tool = (float(made.job.tool[0]), float(made.job.tool[1]), float(made.job.tool[2]))
    try:
        before = predict_uncompensated(solution, tool, DRAWS)
        after = predict_left(solution, made.added_control(), tool, DRAWS)
    except (InputError, NotDeterminedError) as error:
        return [f"It cannot be predicted: {error}"]
    return [
        *table(
            ["", "RMS [µm]", "largest [µm]", "95 % interval of the largest [µm]"],
            [_row("before", before), _row("with these files", after)],
        ),
        "",
        "Of the functional point over the whole working volume, both directions of approach, a rigid motion of the workpiece",
        f"taken out, for the tool vector above; {DRAWS} draws of the parameters. Thermal change, load, dynamics are not in it.",
    ]


def _row(name: str, found: ResidualPrediction) -> list[str]:
    low, high = found.interval
    return [name, f"{1e3 * found.rms:.2f}", f"{1e3 * found.maximum:.2f}", f"{1e3 * low:.2f} … {1e3 * high:.2f}"]
