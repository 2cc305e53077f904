"""Groups of an HDF5 file read strictly: every getter checks that the entry is there, its type and shape, before it reads."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import h5py
import numpy as np

from volid.exceptions import InputError
from volid.io.basics.hdf5_structure import shown

REQUIRED: Any = object()
ALL = slice(None)
Shape = Sequence[int | None]
_JSON_DEPTH = 32
_KINDS = {float: ("fiu", "numbers"), int: ("iu", "whole numbers"), bool: ("b", "truth values")}
_JSON_WORDS: dict[type, str] = {dict: "an object", list: "a list"}
_AT_ONCE = 1024  # texts of any length


@dataclass(frozen=True)
class Group:
    """A group of the file `source`, which is a `what` ("campaign") or part of one; None in a shape stands for any length."""

    raw: h5py.Group
    source: str
    what: str

    @property
    def where(self) -> str:
        """The place in messages: "campaign.h5, /sets/1"."""
        return self.source if self.raw.name == "/" else f"{self.source}, {shown(self.raw.name)}"

    def place(self, name: str) -> str:
        """The place of an entry in messages: "campaign.h5, /sets/1/tool"."""
        return f"{self.source}, {shown(self.raw.name.rstrip('/'))}/{shown(name)}"

    def __contains__(self, name: str) -> bool:
        return name in self.raw

    def names(self) -> list[str]:
        """Names of the entries."""
        return [_text(name, self.where) for name in self.raw]

    @property
    def attributes(self) -> Attributes:
        """Its attributes."""
        return Attributes(self.raw.attrs, self)

    def attributes_of(self, name: str) -> Attributes:
        """The attributes of a dataset in it."""
        return Attributes(self._entry(name, h5py.Dataset, "a dataset").attrs, self)

    def group(self, name: str) -> Group:
        """A group in this one."""
        return Group(self._entry(name, h5py.Group, "a group"), self.source, self.what)

    def groups(self) -> dict[str, Group]:
        """All groups in this one by their names."""
        return {name: self.group(name) for name in self.names()}

    def numbered(self) -> list[Group]:
        """The groups 1, 2, … in this one, in order."""
        names = [str(i + 1) for i in range(len(self.raw))]
        for name in self.names():
            if name not in names:
                raise InputError(f"{self.place(name)}: expected groups named 1, 2, … {len(names)}")
        return [self.group(name) for name in names]

    def missing(self, name: str) -> InputError:
        """The `InputError` for an entry or attribute that is not there."""
        return InputError(
            f"{self.source}: incomplete {self.what}: {self.place(name).removeprefix(self.source + ', ')} is missing; "
            "write it again"
        )

    def _entry(self, name: str, kind: type, words: str) -> Any:
        if name not in self.raw:
            raise self.missing(name)
        found = self.raw[name]
        if not isinstance(found, kind):
            raise InputError(f"{self.place(name)}: expected {words}")
        return found

    def dataset(self, name: str, shape: Shape) -> h5py.Dataset:
        """A dataset of this shape, not read yet."""
        found = self._entry(name, h5py.Dataset, "a dataset")
        if len(found.shape) != len(shape) or any(e not in (None, n) for e, n in zip(shape, found.shape, strict=True)):
            expected = (
                "(" + ", ".join("any" if e is None else str(e) for e in shape) + ("," if len(shape) == 1 else "") + ")"
            )
            raise InputError(f"{self.place(name)}: shape is {found.shape}; expected {expected}")
        return found

    def length(self, name: str, dimensions: int = 1) -> int:
        """Number of rows of a dataset with so many dimensions."""
        return int(self.dataset(name, (None,) * dimensions).shape[0])

    def array(
        self, name: str, shape: Shape, kind: type = float, *, rows: slice = ALL, finite: bool = False
    ) -> np.ndarray:
        """Numbers of a kind (float, int or bool), or some `rows` of them; with `finite`, none is NaN or infinite."""
        dataset = self.dataset(name, shape)
        codes, words = _KINDS[kind]
        if _code(dataset.dtype) not in codes:
            raise InputError(f"{self.place(name)}: holds values of type {dataset.dtype}; expected {words}")
        found: np.ndarray = np.asarray(dataset[rows] if shape else dataset[()]).astype(kind)
        if finite and not np.isfinite(found).all():
            at = ", ".join(str(i + 1) for i in np.argwhere(~np.isfinite(found))[0])
            raise InputError(f"{self.place(name)}: the value at ({at}) is no finite number; expected finite numbers")
        return found

    def texts(self, name: str, shape: Shape = (None,), *, rows: slice = ALL) -> np.ndarray:
        """Texts, shape (m,), or some `rows` of them."""
        dataset = self.dataset(name, shape)
        where, dtype = self.place(name), dataset.dtype
        if h5py.check_string_dtype(dtype) is None:
            raise InputError(f"{where}: holds values of type {dtype}; expected texts")
        try:
            if _code(dtype) == "S":
                return np.char.decode(dataset[rows].astype(bytes), "utf-8")
            return _long_texts(dataset, rows)
        except UnicodeDecodeError:
            raise InputError(f"{where}: is not UTF-8 text; expected texts in UTF-8") from None

    def text(self, name: str) -> str:
        """One text."""
        dataset = self.dataset(name, ())
        if h5py.check_string_dtype(dataset.dtype) is None:
            raise InputError(f"{self.place(name)}: holds a value of type {dataset.dtype}; expected a text")
        return _text(dataset[()], self.place(name))


def _code(dtype: np.dtype) -> str:
    """What values are: "f", "i", "u" numbers, "b" truth values, "S" texts of fixed length, "O" of any."""
    return dtype.str[1]


def _long_texts(dataset: h5py.Dataset, rows: slice) -> np.ndarray:
    """Texts of any length, as other programs write them; together no longer than the file."""
    left = int(dataset.file.id.get_filesize())
    found: list[str] = []
    start, stop, _ = rows.indices(len(dataset))
    for first in range(start, stop, _AT_ONCE):
        part = [bytes(v) for v in dataset[first : min(first + _AT_ONCE, stop)]]
        left -= sum(map(len, part))
        if left < 0:
            raise OSError("its texts are longer than the file")
        found += [text.decode("utf-8") for text in part]
    return np.array(found, dtype=str)


def _text(value: Any, where: str) -> str:
    """A text that can be written again, or an `InputError`."""
    try:
        text = value.decode("utf-8") if isinstance(value, bytes) else str(value)
        text.encode("utf-8")
    except UnicodeError:
        raise InputError(f"{where}: is not UTF-8 text; expected text in UTF-8") from None
    return text


@dataclass(frozen=True)
class Attributes:
    """Attributes of a group, or of a dataset in it; every getter checks the type."""

    raw: Mapping[str, Any]
    group: Group

    def __contains__(self, name: str) -> bool:
        return name in self.raw

    def _where(self, name: str) -> str:
        return f"{self.group.where}, attribute {shown(name)}"

    def _get(self, name: str, default: Any) -> Any:
        if name in self.raw:
            return self.raw[name]
        if default is REQUIRED:
            raise self.group.missing(name)
        return default

    def _wrong(self, name: str, value: Any, expected: str) -> InputError:
        return InputError(f"{self._where(name)} is {shown(str(value))}; expected {expected}")

    def text(self, name: str, default: Any = REQUIRED) -> str:
        """A text."""
        value = self._get(name, default)
        if not isinstance(value, str | bytes):
            raise self._wrong(name, value, "a text")
        return _text(value, self._where(name))

    def all_texts(self) -> dict[str, str]:
        """All attributes as texts."""
        return {_text(name, self.group.where): self.text(name) for name in self.raw}

    def texts(self, name: str) -> tuple[str, ...]:
        """A list of texts."""
        value = np.asarray(self._get(name, REQUIRED))
        if value.ndim != 1 or not all(isinstance(v, str | bytes) for v in value.tolist()):
            raise self._wrong(name, value, "a list of texts")
        return tuple(_text(v, self._where(name)) for v in value.tolist())

    def number(self, name: str, default: Any = REQUIRED, *, finite: bool = True) -> float:
        """A number; without `finite`, NaN and infinity too."""
        value = self._get(name, default)
        if np.ndim(value) or _code(np.asarray(value).dtype) not in "fiu" or (finite and not np.isfinite(value)):
            raise self._wrong(name, value, "a finite number" if finite else "a number")
        return float(value)

    def integer(self, name: str, default: Any = REQUIRED) -> int:
        """A whole number."""
        value = self._get(name, default)
        if np.ndim(value) or _code(np.asarray(value).dtype) not in "iu":
            raise self._wrong(name, value, "a whole number")
        return int(value)

    def flag(self, name: str) -> bool:
        """True or False."""
        value = self._get(name, REQUIRED)
        if np.ndim(value) or _code(np.asarray(value).dtype) != "b":
            raise self._wrong(name, value, "True or False")
        return bool(value)

    def json(self, name: str, kind: type, default: Any = REQUIRED) -> Any:
        """What a JSON text holds: an object or a list (`kind`), nested no deeper than 32."""
        text = self.text(name, default)
        return parse_json(text, kind, self._where(name))


def parse_json(text: str, kind: type, where: str) -> Any:
    """An object (dict) or a list from JSON. Raises `InputError` for anything else, or what is nested deeper than 32."""
    try:
        value = json.loads(text)
        json.dumps(value, ensure_ascii=False).encode("utf-8")
    except (ValueError, RecursionError) as error:
        why = "nested too deeply" if isinstance(error, RecursionError) else shown(str(error))
        raise InputError(f"{where}: no valid JSON ({why}); expected {_JSON_WORDS[kind]} in JSON") from None
    if not isinstance(value, kind) or _depth(value) > _JSON_DEPTH:
        raise InputError(
            f"{where}: is {shown(text)}; expected {_JSON_WORDS[kind]} in JSON, nested no deeper than {_JSON_DEPTH}"
        )
    return value


def _depth(value: Any) -> int:
    depth, level = 0, [value]
    while level:
        depth += 1
        level = [v for item in level for v in _items(item) if isinstance(v, dict | list)]
    return depth


def _items(item: Any) -> list[Any]:
    return list(item.values()) if isinstance(item, dict) else item
