"""ExistingCompensation files of a control: which control they are for, and what it does with them (ISO/TR 16907 10.5).

What a control holds already is read by the control's own `read`, as error values. Where no control is named, the files say it by
their content. What public sources leave open, such as the sign, the user states.
"""

from __future__ import annotations

import difflib
import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import PurePosixPath
from typing import Any

from volid.compensation.control import Control
from volid.compensation.package import Compensation
from volid.controllers import CONTROLS, Controller
from volid.controllers.base import OPEN, Declaration, options_of, sign_of
from volid.controllers.existing.contents import types_of
from volid.exceptions import InputError
from volid.model.machine import Machine

RECOGNISED = "recognised as files of"  # begins what is assumed where no control is named
OWN = "volid"  # in place of a control's name: volid's own tables and grids
RECOGNISED, NO_MACHINE = "recognised as files of", "no machine given"  # how sentences about what was assumed begin
Files = Mapping[str, bytes]


@dataclass(frozen=True, eq=False)
class ExistingCompensation:
    """A compensation that a control holds already, read from its files.

    Args:
        cnc: Name of the control, one of `volid.CONTROLS`, or "volid" for volid's own tables and grids.
        machine: The machine whose axes it moves.
        compensation: What the files hold, as error values (actual - nominal) in mm and rad.
        files: Content of the files by name.
        sign: Sense of the values, as the user stated it; None where the control fixes it.
        options: Options of the control, as the user stated them.
        assumed: What was taken for granted, one sentence each.

    >>> import volid
    >>> path = getfixture("tmp_path") / "x.comp"
    >>> _ = path.write_text("0 0.000 0.002\\n500 500.010 500.013\\n1000 999.996 999.999\\n")
    >>> machine = volid.load_machine("models/wYXbZt_vertical.toml")
    >>> found = volid.load_compensation([path], "linuxcnc", machine)
    >>> found.types, found.compensation.axis_tables[0].forward.round(6).tolist()
    (('L-POS',), [0.0, 0.01, -0.004])
    """

    cnc: str
    machine: Machine
    compensation: Compensation
    files: Files
    sign: str | None = None
    options: Mapping[str, Any] = field(default_factory=dict)
    assumed: tuple[str, ...] = ()

    @property
    def declaration(self) -> Declaration | None:
        """What the control declares; None for volid's own files."""
        return None if self.cnc == OWN else CONTROLS[self.cnc].declaration

    @property
    def types(self) -> tuple[str, ...]:
        """Types of ISO/TR 16907 that the files hold."""
        return types_of(self.compensation, self.machine)

    @property
    def sha256(self) -> str:
        """Hash of names and contents."""
        found = hashlib.sha256()
        for name in sorted(self.files):
            found.update(PurePosixPath(name).name.encode() + b"\0" + self.files[name] + b"\0")
        return found.hexdigest()

    @property
    def words(self) -> str:
        """Types, files, control and hash, as a record names it: "L-POS: x.comp for linuxcnc, sha256 0123456789ab"."""
        names = ", ".join(PurePosixPath(name).name for name in self.files)
        of = "" if self.cnc == OWN else f" for {self.cnc}"
        return f"{' + '.join(self.types) or 'nothing'}: {names}{of}, sha256 {self.sha256[:12]}"

    def control(self, **options: Any) -> Control:
        """The simulated control that holds it; `options`: those of `volid.Control`."""
        return self.compensation.control(self.machine, **options)


def recognised(files: Files) -> Controller:
    """The control whose files these are, by their content; most files decide.

    Raises `InputError` where none of them, or several controls alike, know the files.
    """
    known = {c.declaration.name: len(of_control(files, c)) for c in CONTROLS.values()}
    most = max(known.values(), default=0)
    names = [name for name, count in known.items() if count == most]
    shown = ", ".join(list(files)[:3])
    if most == 0:
        raise InputError(
            f"{shown}: looks like a file of no control that volid knows; say whose it is with `cnc`, one of "
            f"{', '.join(CONTROLS)}"
        )
    if len(names) > 1:
        raise InputError(f"{shown}: may be a file of {' or of '.join(names)}; say of which with `cnc`")
    return CONTROLS[names[0]]


def of_control(files: Files, chosen: Controller) -> dict[str, bytes]:
    """Those of the files that a control recognises."""
    return {name: content for name, content in files.items() if chosen.recognises(name, content)}


def read_existing(
    files: Files,
    machine: Machine,
    cnc: str | None = None,
    *,
    sign: str | None = None,
    options: Mapping[str, Any] | None = None,
) -> ExistingCompensation:
    """What the files of a control hold.

    Args:
        files: Content by name.
        machine: The machine whose axes they move.
        cnc: Name of the control; by default recognised by content.
        sign: "error" or "compensation" where public sources leave the sign of the control open.
        options: Options of the control, see its declaration.

    Raises:
        InputError: the files are of no control that volid knows, they are damaged, or an option or sign is missing or wrong.
    """
    _refuse_twice(files)
    chosen = recognised(files) if cnc is None else control_called(cnc)
    declared = chosen.declaration
    stated = {k: v for k, v in (options or {}).items() if v is not None}
    meaning = sign_of(declared, sign)
    held = chosen.read(files, machine, {**options_of(declared, stated), "sign": meaning})
    if not (held.tables or held.grids or held.axis_tables):
        raise InputError(f"{', '.join(list(files)[:3])}: holds no table or grid of {declared.title}")
    assumed = () if cnc else (f"{RECOGNISED} {declared.name} ({declared.title})",)
    return ExistingCompensation(
        declared.name, machine, held, dict(files), meaning if declared.sign == OPEN else None, stated, assumed
    )


def control_called(cnc: str) -> Controller:
    """The control of a name. Raises `InputError` for a name that there is not."""
    if cnc not in CONTROLS:
        raise unknown_control(cnc)
    return CONTROLS[cnc]


def unknown_control(cnc: str) -> InputError:
    """The error for a name that no control has, with those that are like it.

    >>> str(unknown_control("Sinumerik"))[:80]
    '`cnc=Sinumerik` is no control that volid knows; did you mean sinumerik-enc-comp '
    """
    text = cnc.lower()
    like = [n for n, c in CONTROLS.items() if text and (text in n or text in c.declaration.title.lower())]
    like = like or difflib.get_close_matches(text, list(CONTROLS), cutoff=0.65)
    meant = f"; did you mean {' or '.join(like)}?" if like else ";"
    return InputError(f"`cnc={cnc}` is no control that volid knows{meant} available: {', '.join(CONTROLS)}")


def _refuse_twice(files: Files) -> None:
    """Raises `InputError` for two files of one name in different folders: a control holds one of them."""
    names = [PurePosixPath(name).name for name in files]
    twice = next((name for name in names if names.count(name) > 1), None)
    if twice:
        raise InputError(
            f"two files are called {twice}; a control holds one of them. Name one, or give them other names"
        )
