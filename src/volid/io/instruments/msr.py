"""`.msr`: touches of a probe on a machine, as probing software writes them; spheres are fitted to them.

`G800 N X Y Z I J K` is a nominal point with its normal, `G801 N X Y Z R` the measured centre of the probe's ball and its
radius, `G330 N A B C X Y Z` the work plane of the points that follow: p = Rz(C) Ry(B) Rx(A) p_plane, turns about fixed axes.
Lines `TOOLPATHID`, `TOOLPATH` and `; TOOLPATH` begin a tool path."""

from __future__ import annotations

import re
from collections import Counter
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from volid.exceptions import InputError
from volid.io.basics.csv_rows import names_shown
from volid.io.instruments.base import FROM_DESCRIPTIONS, ForeignFile, Format, Found, ReadingsFormat, Request
from volid.io.instruments.laser_line import unit_of
from volid.io.instruments.numerals import number
from volid.io.instruments.positions import KEY, by_name, read_positions

_TOUCH = re.compile(r"^[ \t]*G801(?=[\sN]).*X", re.MULTILINE)
_WORD = re.compile(r"([A-Z])\s*([^A-Z\s]+)")
_PATH = re.compile(r"^;?[ \t]*TOOLPATH(ID)?\b[ :]*(.*)$")
_CODE = re.compile(r"^(G\d+)\s*(?=[A-Z])(.*)$")
_KNOWN = ("START", "END", "DOCUMENTID", "MODELVERSION", "RESULTSFILE", "TIMESTAMP")


class Msr(ReadingsFormat):
    """Touches of spheres, one tool path a sphere."""

    name = "msr"
    words = "touches of a probe in MSR format"
    about = (
        "centres of the stylus ball (G801), turned by the work plane (G330), taken as tool-tip coordinates on "
        "the workpiece; a sphere "
        f"is fitted to each tool path. With rotary axes, positions = a CSV with their positions by path. {FROM_DESCRIPTIONS}"
    )
    keys = (KEY, "unit")

    def recognises(self, text: str) -> bool:
        """Measured points."""
        return _TOUCH.search(text) is not None

    def read(self, file: ForeignFile, request: Request) -> Found:
        """Every touch. Raises `InputError`."""
        state = _State(file)
        for line, text in enumerate(file.text.split("\n"), start=1):
            state.take(line, text.strip())
        unit = unit_of(request, "mm", "mm")
        columns: dict[str, Any] = {
            "path": state.paths,
            **dict(zip("xyz", np.array(state.points).T.tolist(), strict=True)),
        }
        units = dict.fromkeys("xyz", unit)
        if len(state.balls) == len(state.points):
            columns["ball_radius"], units["ball_radius"] = state.balls, unit
        kept, more, notes = _with_positions(columns, file, request)
        columns = {name: [values[i] for i in kept] for name, values in columns.items()} | more
        rows = [state.rows[i] for i in kept]
        return Found(
            request.table.text("kind", "displacement"),
            columns,
            rows,
            units,
            {"touches": True},
            state.record,
            (*state.notes(), *notes),
        )


@dataclass
class _State:
    """What was read so far: touches in the frame of the part, the tool path and work plane of those that follow."""

    file: ForeignFile
    points: list[np.ndarray] = field(default_factory=list)
    balls: list[float] = field(default_factory=list)
    paths: list[str] = field(default_factory=list)
    rows: list[int] = field(default_factory=list)
    record: dict[str, Any] = field(default_factory=dict)
    turn: np.ndarray = field(default_factory=lambda: np.eye(3))
    nominal: str | None = None
    unmeasured: int = 0
    others: int = 0
    path: str = ""
    begun: int = 0
    fresh: bool = False  # a path has begun, and has no touch yet
    seen: Counter[str] = field(default_factory=Counter)

    def take(self, line: int, text: str) -> None:
        """One line of the file. Raises `InputError` where it is damaged."""
        code = _CODE.match(text)
        if path := _PATH.match(text):
            self._begin(path[2].strip(), is_name=path[1] is None)
        elif code and code[1] in ("G330", "G331", "G800", "G801"):
            getattr(self, f"_{code[1].lower()}")(line, self._words(line, code[2].partition(";")[0]))
        elif text.startswith(("G330", "G800", "G801")):
            raise self.file.wrong(line, f"'{text[:40]}' is cut off", "words such as X12.5 behind it")
        elif (key := text.partition(" ")[0]) in _KNOWN:
            if text[len(key) :].strip():
                self.record[key.lower()] = text[len(key) :].strip()
        elif text and not text.startswith(";"):
            self.others += 1

    def _begin(self, name: str, is_name: bool) -> None:
        """A tool path begins, by its number or by its name, which goes before the number."""
        if not self.fresh:
            self.begun, self.fresh, self.path = self.begun + 1, True, ""
        if name and (is_name or not self.path):
            self.path = name

    def _g331(self, line: int, words: dict[str, float]) -> None:
        """The placement of the part in its drawing, which says nothing of the machine; it begins a tool path."""
        self._begin("", is_name=False)

    def _g330(self, line: int, words: dict[str, float]) -> None:
        if any(words.get(c, 0.0) for c in "XYZ"):
            raise self.file.wrong(
                line, "the work plane is shifted by X, Y, Z", "0 for each: how a shift counts is not documented"
            )
        self._begin("", is_name=False)
        a, b, c = (np.deg2rad(words.get(letter, 0.0)) for letter in "ABC")
        about_x = np.array([[1, 0, 0], [0, np.cos(a), -np.sin(a)], [0, np.sin(a), np.cos(a)]])
        about_y = np.array([[np.cos(b), 0, np.sin(b)], [0, 1, 0], [-np.sin(b), 0, np.cos(b)]])
        about_z = np.array([[np.cos(c), -np.sin(c), 0], [np.sin(c), np.cos(c), 0], [0, 0, 1]])
        self.turn = about_z @ about_y @ about_x

    def _g800(self, line: int, words: dict[str, float]) -> None:
        self.unmeasured += self.nominal is not None
        self.nominal = f"{words.get('N', 0.0):g}"

    def _g801(self, line: int, words: dict[str, float]) -> None:
        if missing := [c for c in "XYZ" if c not in words]:
            raise self.file.wrong(
                line, f"the measured point has no {missing[0]}", "X, Y and Z of the centre of the ball"
            )
        if self.nominal is not None and "N" in words and f"{words['N']:g}" != self.nominal:
            raise self.file.wrong(line, f"point {words['N']:g} follows nominal point {self.nominal}", "the same number")
        self.nominal = None
        if self.fresh or not self.rows:
            self._name()
        self.points.append(self.turn @ [words[c] for c in "XYZ"])
        self.paths.append(self.path)
        self.rows.append(line)
        if "R" in words:
            self.balls.append(words["R"])

    def _name(self) -> None:
        """The name of the path whose first touch comes: its own, with a number where it stood before."""
        name = self.path or f"path {max(self.begun, 1)}"
        self.seen[name] += 1
        self.path, self.fresh = name if self.seen[name] == 1 else f"{name} ({self.seen[name]})", False

    def _words(self, line: int, text: str) -> dict[str, float]:
        """Letters with their numbers."""
        found: dict[str, float] = {}
        for letter, token in _WORD.findall(text):
            value = number(token, ".")
            if value is None or letter in found:
                what = f"{letter} stands twice" if value is not None else f"{letter} is '{token[:40]}'"
                raise self.file.wrong(line, what, "each letter once, with a number with a decimal point")
            found[letter] = value
        if rest := _WORD.sub("", text).strip():
            raise self.file.wrong(line, f"'{rest[:40]}' is no letter with a number", "words such as X12.5")
        return found

    def notes(self) -> tuple[str, ...]:
        """What was left out, in words."""
        found = []
        unmeasured = self.unmeasured + (self.nominal is not None)
        if unmeasured:
            found.append(f"{unmeasured} nominal points have no measured point")
        if self.others:
            found.append(f"{self.others} lines that hold no touches were left out")
        return tuple(found)


def _with_positions(
    columns: dict[str, Any], file: ForeignFile, request: Request
) -> tuple[list[int], dict[str, Any], tuple[str, ...]]:
    """Which touches have a position, the columns of these positions, and what did not match."""
    letters = [a.letter for a in request.machine.axes if not a.is_linear]
    positions = read_positions(request, [*letters, "path"])
    everything = list(range(len(columns["path"])))
    if positions is None:
        if letters:
            paths = list(dict.fromkeys(columns["path"]))
            raise InputError(
                f"{request.table.where}: {file.path} does not hold the positions of {', '.join(letters)}; "
                "expected positions = a CSV "
                f"with columns path,{','.join(letters)} and a row for each of its tool paths: {names_shown(paths)}"
            )
        return everything, {}, ()
    paths = list(dict.fromkeys(columns["path"]))
    row_of, notes = by_name(positions, "path", paths)
    found = dict(zip(paths, row_of.tolist(), strict=True))
    rows = np.array([found[path] for path in columns["path"]])
    kept = np.flatnonzero(rows >= 0)
    more = positions.columns(rows[kept])
    return kept.tolist(), {k: v for k, v in more.items() if k not in "XYZ" and not k.endswith("_dir")}, notes


MSR: Format = Msr()
