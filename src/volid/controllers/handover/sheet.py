"""The commissioning sheet: what one person does at the machine, from the backup to the way back, and how the sign is proved.

It is made from the declaration of the control and from what the control holds, which was read back from its files, so that it
says what these files do and not what was wanted. One sheet for each export; it prints as plain text.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from volid.compensation.active import axis_table_words
from volid.compensation.helping_axes import helping_words
from volid.compensation.package import Compensation
from volid.controllers.base import COLUMNS, HELD, NO_REVERSAL, ONE_VALUE, OPEN
from volid.controllers.export import Export
from volid.controllers.handover.explain import commissioning, fact_lines, properties_of_files
from volid.controllers.handover.markdown import bullets, heading, steps, table, text_of
from volid.controllers.handover.sign_check import SignCheck, short_grid_words, sign_checks, with_unit
from volid.model.machine import Machine

SAFE = "Work without tool and workpiece, with a low feed override, until section 5 is done."
_NO_PARAMETERS = "No parameter beside those named in the steps."


def commissioning_sheet(made: Export) -> str:
    """The sheet of an export, a text with headings, boxes to tick and tables."""
    d, machine = made.declaration, made.job.machine
    lines = heading(f"Commissioning sheet: {d.title}", 1)
    lines += [f"Machine: {machine.name} [{machine.structure.strip().strip('[]')}]", ""]
    lines += [f"Compensation: {', '.join(made.types) or 'as read from files'}", "", SAFE]
    lines += [*heading("Files in this folder"), *_files(made)]
    done = dict(commissioning(d))
    lines += [*heading("1. Back up"), *steps(done["Back up"])]
    lines += [*heading("2. Parameters to set"), *_parameters(made)]
    lines += [*heading("3. Load"), *steps(done["Load"])]
    lines += [*heading("4. Activate"), *steps(done["Activate"])]
    lines += [*heading("5. Prove the sign: one point for each table"), *_signs(made)]
    lines += [*heading("6. Switch each compensation on and off"), *_switching(made)]
    lines += [*heading("7. What the control does with these values"), *_behaviour(made)]
    lines += [*heading("8. Remove again"), *steps(done.get("Remove again", ("Restore the backup of section 1.",)))]
    lines += [*heading("9. What is known of this control, and on what it rests"), *fact_lines(d.facts)]
    if made.notes:
        lines += [*heading("Notes"), *bullets(made.notes)]
    return text_of(lines)


def checks_of(made: Export) -> tuple[SignCheck, ...]:
    """The sign checks of an export; where reversal is a parameter, with this parameter at 0."""
    held, job, both = made.held, made.job, made.declaration.reversal == COLUMNS
    if not both:
        plain = (made.controller.without_reversal_value(t, job.options) for t in held.axis_tables)
        held = replace(held, axis_tables=tuple(plain))
    return sign_checks(held, job, both, lambda t: made.controller.only_together(t, made.held, job.options))


def _files(made: Export) -> list[str]:
    rows = [[f.name, f.what] for f in made.written.files]
    rows += [["COMMISSIONING.md", "this sheet"], ["RECORD.md", "what the values are, and where they come from"]]
    return table(["file", "what it is"], rows)


def _parameters(made: Export) -> list[str]:
    found = made.written.parameters
    return table(["parameter", "value", "meaning"], found) if found else [_NO_PARAMETERS]


def _signs(made: Export) -> list[str]:
    """What to command and what must be seen, one row for each table."""
    checks = checks_of(made)
    lines = ["For each row:", "", *(f"{i}. {text}" for i, text in enumerate(_HOW, start=1)), "", *_READING, ""]
    lines += bullets(f"Shown by the control: {text}" for text in made.declaration.commissioning.watch)
    lines += [""]
    if made.declaration.sign == OPEN:
        lines += [
            f"**Public sources do not say which sign this control wants. These files hold {made.job.sign} values. Do not cut",
            "before this is proved.** Where an axis moves the other way, remove the files and export again with the other sign.",
            "",
        ]
    else:
        lines += ["Where an axis moves the other way, remove the files (section 8) and do not use them.", ""]
    if made.declaration.reversal == ONE_VALUE:
        lines += [
            "Set the reversal value (backlash) of the axes to 0 for this check, and back to its value afterwards.",
            "",
        ]
    if not checks:
        return [*lines, "All values are zero: there is nothing to see."]
    lines += table(_HEADER, [_row(made.job.machine, c) for c in checks])
    if any(c.is_small for c in checks):
        lines += [
            "",
            "Motions below 0.003 mm or 0.001° are too small for a dial: take what the control shows, or an interferometer.",
        ]
    if any(c.unit == "°" for c in checks):
        lines += ["", "At a distance of 100 mm from a rotary axis, 0.001° are 0.0017 mm at the indicator."]
    if any(c.is_together for c in checks):
        lines += [
            "",
            "Tables that are multiplied, and those with them, are seen with all of them loaded, not alone (-).",
        ]
    return [*lines, "", f"Tool vector of these numbers: {', '.join(f'{v:g}' for v in made.job.tool)} mm."]


_HOW = (
    "Switch the compensation off, and go to the position in 'command', all axes coming from the stated side (below: in +).",
    "Set an indicator at the axis that is named to zero, or note the position of its drive where the control shows it.",
    "Switch the compensation on (section 4), go away, and come back to the position from the same side.",
    "The axis must now stand off by what the row says, in the direction in which a command of this size would move it.",
)
_READING = (
    "'Alone' holds where the other tables of this folder are off or zero, 'all loaded' for all of them together; other",
    "compensations of these axes are off. A position display may show the programmed position without the correction.",
)
_HEADER = [
    "[ ] table",
    "command, mm or °",
    "coming from",
    "axis",
    "must move by (alone)",
    "stands at (alone)",
    "moves by (all loaded)",
]


def _row(machine: Machine, check: SignCheck) -> list[str]:
    place = "  ".join(f"{a} {v:.9g}" for a, v in check.at.items())
    side = "above (-)" if check.way < 0 else "below (+)"
    stands = f"{check.axis} {check.at[check.axis] + check.alone:.6f}"
    alone, together = (with_unit(machine, check.axis, v, sign=True) for v in (check.alone, check.together))
    if check.is_together:
        alone, stands = "-", "-"
    return [f"[ ] {check.table}", place, side, check.axis, alone, stands, together]


def _switching(made: Export) -> list[str]:
    return [f"{_sentence(made.declaration.switching)}", "", "Loaded are:", "", *bullets(parts_of(made.held))]


def parts_of(held: Compensation) -> list[str]:
    """Each table and grid in words, with the range of its positions."""
    found = [f"{axis_table_words(t)}, {_span(t.positions)}" for t in held.axis_tables]
    found += [f"table of {t.function} over {t.axis}, {_span(t.positions)}" for t in held.tables]
    return found + [
        f"{short_grid_words(g)}, {', '.join(f'{a} {_span(n)}' for a, n in zip(g.axes, g.nodes, strict=True))}"
        for g in held.grids
    ]


def _span(positions: np.ndarray) -> str:
    return f"{positions[0]:g} … {positions[-1]:g} ({len(positions)} positions)"


def _behaviour(made: Export) -> list[str]:
    """Meaning of the values, ends, reversal, and axes that only help."""
    d = made.declaration
    own = made.controller.of_these_files(made.job.options)
    lines = table(["property", "of these files"], properties_of_files(d, made.job.sign, own))
    lines += [""]
    if d.outside != HELD:
        lines += bullets(["Beyond the positions of a table its effect is not sure: keep the axes within them."])
    if d.reversal == ONE_VALUE:
        lines += bullets(["Reversal is one value for each axis: what it varies by along the travel is not corrected."])
    if d.reversal == NO_REVERSAL:
        lines += bullets(["Values are the mean of both directions: half the reversal is left in either direction."])
    helping = [h for h in made.helping if h.turns or h.too_small]
    lines += bullets(_sentence(helping_words(made.job.machine, h)) for h in helping)
    if not helping:
        lines += bullets(["No axis that only helps turns along the travel of another one."])
    return lines


def _sentence(text: str) -> str:
    """With a capital and a full stop; a name such as lr_param.ssfk stays as it is."""
    begin = text.split(" ")[0].strip(",;:")
    return f"{text[:1].upper() if begin.isalpha() and begin.islower() else text[:1]}{text[1:]}."
