"""ExistingCompensation compensations from disk: files of controls, and volid's own tables and grids."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from volid.campaign import Campaign
from volid.compensation.package import Compensation
from volid.controllers import CONTROLS
from volid.controllers.existing.contents import moved_axes, nodes_by_axis
from volid.controllers.existing.reading import (
    NO_MACHINE,
    OWN,
    ExistingCompensation,
    control_called,
    of_control,
    read_existing,
    recognised,
)
from volid.exceptions import InputError
from volid.io.basics.encodings import read_bytes
from volid.io.exports import RECORD, SHEET
from volid.io.machines import parse_machine
from volid.io.own_files import is_own, own_compensation, own_paths
from volid.model.machine import Machine

_LETTERS = "XYZABC"
_WIDE = {letter: (-1e5, 1e5) for letter in "XYZ"} | {letter: (-360.0, 360.0) for letter in "ABC"}


def load_compensation(
    paths: Iterable[str | Path],
    cnc: str | None = None,
    machine: Machine | None = None,
    *,
    sign: str | None = None,
    options: Mapping[str, Any] | None = None,
) -> ExistingCompensation:
    """The compensation that a control holds already, from its files.

    Args:
        paths: Files, and folders of them; of a folder only the files that the control recognises are read.
        cnc: Name of the control, one of `volid.CONTROLS`, or "volid" for volid's own tables and grids; by default recognised by
            content.
        machine: The machine whose axes it moves; by default a plain one with the axes that the files name, none of them on the
            workpiece side of the bed, over the positions that the files hold.
        sign: "error" or "compensation" where public sources leave the sign of the control open.
        options: Options of the control, see its declaration.

    Raises:
        InputError: a file is missing or damaged, is of no control that volid knows, or an option or sign is missing or wrong.

    >>> import numpy as np
    >>> import volid
    >>> path = getfixture("tmp_path") / "x.comp"
    >>> _ = path.write_text("0 0.000 0.002\\n500 500.010 500.013\\n1000 999.996 999.999\\n")
    >>> found = volid.load_compensation([path], "linuxcnc")
    >>> found.machine.letters, found.assumed
    (('X',), ('no machine given: a plain one with the axes X, its structure w b X t',))
    >>> found.control().command(np.array([[500.0]]), None, np.array([[1.0]])).tolist()
    [[499.99]]
    """
    named = tuple(map(Path, paths))
    if cnc == OWN or (cnc is None and named and all(is_own(path) for path in named)):
        return _own(named, machine)
    files = _contents(named, cnc)
    if not files:
        raise InputError(f"{', '.join(map(str, named)) or 'no file'}: holds no file; name the files of a control")
    if machine is not None:
        return read_existing(files, machine, cnc, sign=sign, options=options)
    chosen = cnc or recognised(files).declaration.name
    try:
        wide = read_existing(files, _plain(_LETTERS, _WIDE), chosen, sign=sign, options=options)
        plain, sentence = _plain_of(wide.compensation)
        found = read_existing(files, plain, cnc, sign=sign, options=options)
    except InputError as error:
        raise InputError(f"{error}. No machine was given; if the files need one, name it with `machine`") from None
    return ExistingCompensation(
        found.cnc, plain, found.compensation, files, found.sign, found.options, (*found.assumed, sentence)
    )


def existing_of(
    machine: Machine,
    paths: Iterable[str | Path],
    cnc: str | None = None,
    *,
    sign: str | None = None,
    options: Mapping[str, Any] | None = None,
) -> tuple[ExistingCompensation, ...]:
    """What files of volid and of one control hold, each together; what no control knows is read, and refused, as volid's own.

    Arguments and errors are those of `load_compensation`; `cnc` is of the files that volid did not write.
    """
    named = tuple(map(Path, paths))
    foreign = [p for p in named if not is_own(p) and (cnc not in (None, OWN) or _best(_contents((p,), None)))]
    own = tuple(p for p in named if p not in foreign)
    found = [_own(own, machine)] if own else []
    if foreign:
        found.append(load_compensation(foreign, cnc, machine, sign=sign, options=options))
    return tuple(found)


def read_contents(
    files: Mapping[str, bytes],
    machine: Machine,
    cnc: str | None = None,
    *,
    sign: str | None = None,
    options: Mapping[str, Any] | None = None,
) -> ExistingCompensation:
    """As `load_compensation`, of files whose content is in memory by name, such as those that a campaign holds."""
    with TemporaryDirectory() as folder:
        paths = [Path(folder) / name for name in files]
        for path in paths:
            if path.parent != Path(folder):
                raise InputError(f"{path.name}: expected the name of a file without folders")
            path.write_bytes(files[path.name])
        if cnc != OWN and not (cnc is None and all(is_own(p) for p in paths)):
            return read_existing(files, machine, cnc, sign=sign, options=options)
        try:
            return ExistingCompensation(OWN, machine, own_compensation(machine, paths), dict(files))
        except InputError as error:
            raise InputError(str(error).replace(f"{folder}/", "")) from None


def recorded_compensations(campaign: Campaign) -> tuple[ExistingCompensation, ...]:
    """What was active while a campaign was measured, as far as its record names files.

    Args:
        campaign: The campaign; it holds the files themselves.

    Raises:
        InputError: a file cannot be read any more.

    >>> import volid
    >>> volid.recorded_compensations(volid.load_campaign("datasets/published_positioning/campaign.toml"))
    ()
    """
    return tuple(
        read_contents(a.files, campaign.machine, a.cnc, sign=a.sign or None, options=a.options)
        for a in campaign.active_files
    )


def _own(paths: tuple[Path, ...], machine: Machine | None) -> ExistingCompensation:
    """Tables and grids of volid."""
    files = {p.as_posix(): read_bytes(p) for p in own_paths(paths)}
    if machine is not None:
        return ExistingCompensation(OWN, machine, own_compensation(machine, paths), files)
    made = own_compensation(_plain(_LETTERS, _WIDE), paths)
    plain, sentence = _plain_of(made)
    return ExistingCompensation(OWN, plain, made, files, assumed=(sentence,))


def _in_folder(path: Path) -> list[Path]:
    """A file, or the files of a folder without what volid writes for people."""
    if not path.is_dir():
        return [path]
    return sorted(
        p for p in path.iterdir() if p.is_file() and not p.name.startswith(".") and p.name not in (SHEET, RECORD)
    )


def _contents(paths: tuple[Path, ...], cnc: str | None) -> dict[str, bytes]:
    """Content by name; of a folder only what the control, or any control, recognises, where it recognises anything."""
    found: dict[str, bytes] = {}
    for path in paths:
        inside = {p.as_posix(): read_bytes(p) for p in _in_folder(path)}
        if path.is_dir():
            chosen = control_called(cnc) if cnc else _best(inside)
            inside = (chosen and _with_named(of_control(inside, chosen), inside)) or inside
        found |= inside
    return found


def _with_named(known: Mapping[str, bytes], inside: Mapping[str, bytes]) -> dict[str, bytes]:
    """Files that a control recognises, and those of the same folder whose names stand in them, as in a list of files."""
    text = b"\n".join(known.values()).lower()
    named = {n: c for n, c in inside.items() if known and Path(n).name.lower().encode() in text}
    return {n: c for n, c in inside.items() if n in known or n in named}


def _best(files: Mapping[str, bytes]) -> Any:
    """The control that recognises most of the files; None where none recognises any."""
    counts = {name: len(of_control(files, c)) for name, c in CONTROLS.items()}
    name = max(counts, key=lambda n: counts[n], default=None)
    return CONTROLS[name] if name is not None and counts[name] else None


def _plain(letters: Iterable[str], ranges: Mapping[str, tuple[float, float]]) -> Machine:
    """A machine with all axes on the tool side, linear ones first."""
    chosen = [a for a in _LETTERS if a in letters]
    lines = ['format = "volid-machine/1"', f'name = "{NO_MACHINE}"', f'structure = "w b {" ".join(chosen)} t"']
    for letter in chosen:
        low, high = ranges[letter]
        lines += [f"[axis.{letter}]", f"travel = [{low!r}, {high!r}]"]
        lines += ["point = [0.0, 0.0, 0.0]"] if letter in "ABC" else []
    return parse_machine("\n".join(lines) + "\n", "a plain machine")


def _plain_of(made: Compensation) -> tuple[Machine, str]:
    """A plain machine for what was read, over its positions, and a sentence that says so."""
    nodes = nodes_by_axis(made)
    letters = {*nodes, *moved_axes(made)}
    if made.grids or made.tables:  # their values move the functional point, which the linear axes carry
        letters |= set("XYZ")
    ranges = {a: (float(n[0]), float(n[-1])) for a, n in nodes.items() if n[-1] > n[0]}
    machine = _plain(letters, {**{a: (0.0, 1000.0) for a in letters}, **ranges})
    code = machine.structure.strip()
    return machine, f"{NO_MACHINE}: a plain one with the axes {', '.join(machine.letters)}, its structure {code}"
