"""How texts, numbers and format tags are stored in the HDF5 files of volid."""

from __future__ import annotations

import json
import os
import stat
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from volid.exceptions import InputError
from volid.exceptions import shown as named
from volid.io.basics.hdf5_group import Group
from volid.io.basics.hdf5_guard import is_known, remember, unfit
from volid.io.basics.hdf5_seal import BLOCK, SIGNATURE, begins_like_hdf5, damaged
from volid.io.basics.hdf5_structure import Unfit, check_structure, shown
from volid.io.basics.toml_table import made_by, wrong_format

_COMPRESSION = {"compression": "gzip", "compression_opts": 1, "shuffle": True}
# What h5py and NumPy make of contents that are wrong in a way that no check foresees
_UNFORESEEN = (OSError, RuntimeError, ValueError, TypeError, LookupError, ArithmeticError, AttributeError, MemoryError)


def is_hdf5(path: str | Path) -> bool:
    """True when the file begins like an HDF5 file, even if it is incomplete. Raises `InputError` when it cannot be read.

    What is no regular file is not HDF5, and nothing is read from it.
    """
    try:
        if not stat.S_ISREG(os.stat(path).st_mode):
            return False
        with open(path, "rb") as file:
            return begins_like_hdf5(file.read(BLOCK + len(SIGNATURE)))
    except FileNotFoundError:
        raise InputError(f"{path}: there is no such file; check the name and the folder") from None
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}; expected a file") from None


@contextmanager
def opened(path: str | Path, what: str) -> Iterator[Group]:
    """The root of a `what` ("campaign"), after a check of the whole file: its checksum, its links, types and sizes.

    Raises `InputError` when the file is damaged or holds what cannot be read safely, also for what goes wrong as it is read.
    """
    try:
        known = is_known(path)
        with h5py.File(path, "r") as file:
            if not known:
                check_structure(file, os.path.getsize(path))
                remember(path)
            yield Group(file, str(path), what)
    except Unfit as error:
        raise unfit(path, str(error)) from None
    except _UNFORESEEN as error:
        raise damaged(path, shown(str(error))) from error


@contextmanager
def reading(path: str | Path, what: str, tag: str) -> Iterator[Group]:
    """The root of an open file, its format checked; `what` ("campaign") and `tag` ("volid-campaign/1") are what is expected.

    Raises `InputError` when the file is missing, truncated, not HDF5, of another type or version, or incomplete.
    """
    if not is_hdf5(path):
        raise InputError(f"{path}: not an HDF5 file; expected a {what} written by volid, '{tag}', {made_by(tag)}")
    with opened(path, what) as root:
        check_format(root, tag)
        yield root


def check_format(group: Group, tag: str) -> None:
    """The attribute `format` must be `tag`. Raises `InputError` for another file type or version."""
    if "format" not in group.attributes:
        raise InputError(f"{group.where}: HDF5, but no volid file: attribute 'format' is missing; expected '{tag}'")
    found = group.attributes.text("format")
    if found != tag:
        raise wrong_format(group.where, shown(found), tag)


def to_json(value: Any) -> str:
    """JSON text; mappings, NumPy numbers and arrays included."""
    return json.dumps(value, ensure_ascii=False, default=_plain)


def _plain(value: Any) -> Any:
    return dict(value) if isinstance(value, Mapping) else value.tolist()


def write_text(group: h5py.Group, name: str, values: Any) -> None:
    """Texts, shape (m,), as UTF-8 of fixed length, which compresses well."""
    encoded = _encoded(np.asarray(values, dtype=str))
    dtype = h5py.string_dtype("utf-8", max(encoded.dtype.itemsize, 1))
    group.create_dataset(name, data=encoded.astype(dtype), **_filter(encoded))


def _encoded(texts: np.ndarray) -> np.ndarray:
    """UTF-8; names of files that are no text appear as in messages."""
    try:
        return np.char.encode(texts, "utf-8")
    except UnicodeEncodeError:
        return np.char.encode(np.vectorize(named, otypes=[str])(texts), "utf-8")


def write_array(group: h5py.Group, name: str, values: Any, dtype: Any = float, unit: str = "") -> h5py.Dataset:
    """Numbers of any shape, losslessly compressed, with their unit as attribute where there is one."""
    dataset = group.create_dataset(name, data=np.asarray(values, dtype=dtype), **_filter(values))
    if unit:
        dataset.attrs["unit"] = unit
    return dataset


def _filter(values: Any) -> dict[str, Any]:
    return _COMPRESSION if np.size(values) and np.ndim(values) else {}
