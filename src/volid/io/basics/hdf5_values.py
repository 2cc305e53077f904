"""How texts, numbers and format tags are stored in the HDF5 files of volid."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from volid.exceptions import InputError, shown
from volid.io.basics.toml_table import made_by, wrong_format

_SIGNATURE = b"\x89HDF\r\n\x1a\n"
_COMPRESSION = {"compression": "gzip", "compression_opts": 1, "shuffle": True}


def is_hdf5(path: str | Path) -> bool:
    """True when the file begins like an HDF5 file, even if it is incomplete. Raises `InputError` when it cannot be read."""
    try:
        with open(path, "rb") as file:
            return file.read(len(_SIGNATURE)) == _SIGNATURE
    except FileNotFoundError:
        raise InputError(f"{path}: there is no such file; check the name and the folder") from None
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}; expected a file") from None


@contextmanager
def reading(path: str | Path, what: str, tag: str) -> Iterator[h5py.File]:
    """The open file, its format checked; `what` ("campaign") and `tag` ("volid-campaign/1") are what is expected.

    Raises `InputError` when the file is missing, truncated, not HDF5, of another type or version, or incomplete.
    """
    if not is_hdf5(path):
        raise InputError(f"{path}: not an HDF5 file; expected a {what} written by volid, '{tag}', {made_by(tag)}")
    try:
        with h5py.File(path, "r") as file:
            check_format(file, str(path), tag)
            yield file
    except KeyError as error:
        raise InputError(f"{path}: incomplete {what}: {error.args[0]}; write it again") from None
    except (OSError, json.JSONDecodeError) as error:
        raise InputError(f"{path}: the HDF5 file is truncated or damaged ({error}); copy or write it again") from None


def check_format(group: h5py.Group, where: str, tag: str) -> None:
    """The attribute `format` must be `tag`. Raises `InputError` for another file type or version."""
    found = group.attrs.get("format")
    if found is None:
        raise InputError(f"{where}: HDF5, but no volid file: attribute 'format' is missing; expected '{tag}'")
    if found != tag:
        raise wrong_format(where, str(found), tag)


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
        return np.char.encode(np.vectorize(shown, otypes=[str])(texts), "utf-8")


def read_text(dataset: h5py.Dataset, rows: slice = slice(None)) -> np.ndarray:
    """Texts written by `write_text`, shape (m,), or some `rows` of them."""
    return np.char.decode(dataset[rows].astype(bytes), "utf-8")


def write_array(group: h5py.Group, name: str, values: Any, dtype: Any = float, unit: str = "") -> h5py.Dataset:
    """Numbers of any shape, losslessly compressed, with their unit as attribute where there is one."""
    dataset = group.create_dataset(name, data=np.asarray(values, dtype=dtype), **_filter(values))
    if unit:
        dataset.attrs["unit"] = unit
    return dataset


def _filter(values: Any) -> dict[str, Any]:
    return _COMPRESSION if np.size(values) and np.ndim(values) else {}
