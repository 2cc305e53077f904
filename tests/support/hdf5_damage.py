"""Ways in which an HDF5 file goes wrong: bytes changed, cut, moved; entries of another shape, type or value, links, bombs."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np

DEEP = '{"a":' * 3000 + "1" + "}" * 3000
ODD_NUMBERS = (np.nan, np.inf, -1.0, 0.0, 1e300, -1e300, 2.0**63)
ODD_ATTRIBUTES: tuple[Any, ...] = (
    *ODD_NUMBERS, "", "text", "\x1b[31m", "{}", "[]", "null", '{"a": 1}', "[1, [2]]", DEEP, "9" * 5000, True, -7, 10**15,
    [1.0, np.nan], ["a", "b"], np.zeros((2, 2)), np.bytes_(b"\xff\xfe"), h5py.Empty("f8"),
)  # fmt: skip


# ------------------------------------------------------------------------------------------------ bytes


def flip_bit(data: bytearray, rng: np.random.Generator) -> bytearray:
    data[rng.integers(len(data))] ^= 1 << int(rng.integers(8))
    return data


def change_bytes(data: bytearray, rng: np.random.Generator) -> bytearray:
    for _ in range(rng.integers(2, 60)):
        data[rng.integers(len(data))] = int(rng.integers(256))
    return data


def cut(data: bytearray, rng: np.random.Generator) -> bytearray:
    return data[: rng.integers(len(data))]


def splice(data: bytearray, rng: np.random.Generator) -> bytearray:
    length = int(rng.integers(1, max(2, len(data) // 8)))
    a, b = (int(rng.integers(len(data) - length)) for _ in range(2))
    data[b : b + length] = data[a : a + length]
    return data


def clear(data: bytearray, rng: np.random.Generator) -> bytearray:
    length = int(rng.integers(1, max(2, len(data) // 8)))
    a = int(rng.integers(len(data) - length))
    data[a : a + length] = bytes([int(rng.choice([0, 255]))]) * length
    return data


def shift(data: bytearray, rng: np.random.Generator) -> bytearray:
    a = int(rng.integers(len(data)))
    if rng.integers(2):
        return data[:a] + bytes(rng.integers(1, 100)) + data[a:]
    return data[:a] + data[a + int(rng.integers(1, 100)) :]


BYTES: tuple[Callable[[bytearray, np.random.Generator], bytearray], ...] = (
    flip_bit, flip_bit, flip_bit, change_bytes, cut, splice, clear, shift,
)  # fmt: skip


# ------------------------------------------------------------------------------------------------ entries


def _entries(file: h5py.File, kind: type) -> list[str]:
    found: list[str] = []
    file.visititems(lambda name, item: found.append(name) if isinstance(item, kind) else None)
    return [name for name in found if not name.startswith("functions/") or "volid-truth" in str(file.attrs["format"])]


def _one(file: h5py.File, rng: np.random.Generator, kind: type = h5py.Dataset) -> str:
    names = _entries(file, kind)
    return names[rng.integers(len(names))]


def _replace(file: h5py.File, name: str, data: Any, **options: Any) -> None:
    attributes = dict(file[name].attrs)
    del file[name]
    file.create_dataset(name, data=data, **options).attrs.update(attributes)


def remove(file: h5py.File, rng: np.random.Generator) -> None:
    del file[_one(file, rng, (h5py.Dataset, h5py.Group))]


def other_type(file: h5py.File, rng: np.random.Generator) -> None:
    name = _one(file, rng)
    n = file[name].shape
    pair = np.zeros(n, [("a", "f8"), ("b", "i4")])
    choices = (
        np.zeros(n), np.zeros(n, int), np.zeros(n, bool), np.zeros(n, complex), np.full(n, b"text"), pair, np.zeros(n, "f2"),
        np.full(n, file.ref, h5py.ref_dtype), np.full(n, "t\xe9xt", h5py.string_dtype()), np.zeros(n, ">f8"), np.full(n, b"\xff"),
    )  # fmt: skip
    _replace(file, name, choices[rng.integers(len(choices))])


def other_shape(file: h5py.File, rng: np.random.Generator) -> None:
    name = _one(file, rng)
    flat = np.atleast_1d(file[name][()])
    choices = [
        flat[:-1], np.concatenate([flat, flat[:1]]), flat[None], flat[..., None], flat.ravel(), flat.T, flat[:0],
        np.repeat(flat, 2, axis=-1), *flat.ravel()[:1],
    ]  # fmt: skip
    _replace(file, name, choices[rng.integers(len(choices))], dtype=file[name].dtype)


def other_values(file: h5py.File, rng: np.random.Generator) -> None:
    name = _one(file, rng)
    a = np.array(file[name][()])
    flat = a.reshape(-1)
    if a.dtype.kind == "f" and a.size:
        flat[rng.integers(a.size, size=rng.integers(1, 4))] = ODD_NUMBERS[rng.integers(len(ODD_NUMBERS))]
    elif a.dtype.kind in "iu" and a.size:
        flat[rng.integers(a.size)] = rng.integers(-120, 120) if a.dtype.kind == "i" else 200
    elif a.dtype.kind == "S" and a.size:
        flat[rng.integers(a.size)] = (b"", b"?", b"\xff\xfe", b"[1", b"\x1b")[rng.integers(5)]
    else:
        a = rng.permutation(np.atleast_1d(a)).reshape(a.shape)
    file[name][...] = a


def bomb(file: h5py.File, rng: np.random.Generator) -> None:
    name = _one(file, rng)
    shape = (400_000_000, *file[name].shape[1:])
    attributes = dict(file[name].attrs)
    del file[name]
    options = ({"chunks": True}, {}, {"chunks": True, "compression": "gzip"})[rng.integers(3)]
    file.create_dataset(name, shape=shape, dtype="f8", **options).attrs.update(attributes)


def long_texts(file: h5py.File, rng: np.random.Generator) -> None:
    name = _one(file, rng)
    shape = file[name].shape
    del file[name]
    file.create_dataset(name, shape=shape, dtype=f"S{10 ** int(rng.integers(5, 9))}", chunks=None)


def other_attribute(file: h5py.File, rng: np.random.Generator) -> None:
    items = [file, *(file[name] for name in _entries(file, (h5py.Dataset, h5py.Group)))]
    items = [item for item in items if len(item.attrs)]
    item = items[rng.integers(len(items))]
    name = list(item.attrs)[rng.integers(len(item.attrs))]
    if rng.integers(6) == 0:
        del item.attrs[name]
    else:
        item.attrs[name] = ODD_ATTRIBUTES[rng.integers(len(ODD_ATTRIBUTES))]


def other_json(file: h5py.File, rng: np.random.Generator) -> None:
    """One leaf or entry of a JSON text becomes something else."""
    places = [file, *(file[name] for name in _entries(file, h5py.Group))]
    texts = [
        (p, n) for p in places for n, v in p.attrs.items() if isinstance(v, str) and v[:1] in ("{", "[") and len(v) > 2
    ]
    if not texts:
        return other_attribute(file, rng)
    item, name = texts[rng.integers(len(texts))]
    value = json.loads(item.attrs[name])
    item.attrs[name] = json.dumps(_changed(value, rng))
    return None


def _changed(value: Any, rng: np.random.Generator) -> Any:
    odd = (None, "text", -1, 1e300, float("nan"), [], {}, [1, "a"], True, 10**30, {"a": {"b": []}})
    if not isinstance(value, dict | list) or not value or rng.integers(4) == 0:
        return odd[rng.integers(len(odd))]
    keys = list(value) if isinstance(value, dict) else range(len(value))
    key = keys[rng.integers(len(keys))]
    if rng.integers(6) == 0:
        value.pop(key)
    else:
        value[key] = _changed(value[key], rng)
    return value


def links(file: h5py.File, rng: np.random.Generator) -> None:
    name = _one(file, rng, (h5py.Dataset, h5py.Group))
    parent = file[name].parent
    how = rng.integers(5)
    if how < 3:
        del file[name]
    if how == 0:
        file[name] = h5py.SoftLink("/" + name)
    elif how == 1:
        file[name] = h5py.ExternalLink("/etc/hostname", "/")
    elif how == 2:
        file[name] = file["/"]
    elif how == 3:
        parent["again"] = parent
    else:
        group = parent
        for _ in range(int(rng.integers(5, 300))):
            group = group.create_group("deeper")


def elsewhere(file: h5py.File, rng: np.random.Generator) -> None:
    """Values in another file: external storage, or a virtual dataset."""
    name = _one(file, rng)
    dataset = file[name]
    shape, dtype = dataset.shape or (1,), dataset.dtype if dataset.dtype.kind != "O" else np.dtype("S64")
    del file[name]
    if rng.integers(2):
        size = int(np.prod(shape)) * dtype.itemsize
        file.create_dataset(name, shape, dtype, external=[("/etc/passwd", 0, max(size, 1))])
    else:
        layout = h5py.VirtualLayout(shape, dtype)
        layout[...] = h5py.VirtualSource("/etc/nothing.h5", "x", shape)
        file.create_virtual_dataset(name, layout)


def group_for_dataset(file: h5py.File, rng: np.random.Generator) -> None:
    name = _one(file, rng, (h5py.Dataset, h5py.Group))
    was = isinstance(file[name], h5py.Dataset)
    del file[name]
    if was:
        file.create_group(name)
    else:
        file[name] = 1.0


def extra(file: h5py.File, rng: np.random.Generator) -> None:
    groups = ["/", *_entries(file, h5py.Group)]
    group = file[groups[rng.integers(len(groups))]]
    if rng.integers(2):
        group.create_group(("x", "99", "\x1b[2J")[rng.integers(3)]).attrs["a"] = 1
    else:
        group.create_dataset(("x", "0", "\x1b[2J")[rng.integers(3)], data=np.zeros(3))


ENTRIES: tuple[Callable[[h5py.File, np.random.Generator], Any], ...] = (
    remove, other_type, other_type, other_shape, other_shape, other_values, other_values, other_values, bomb, long_texts,
    other_attribute, other_attribute, other_attribute, other_json, other_json, links, elsewhere, group_for_dataset, extra,
)  # fmt: skip


def change_entry(path: Path, rng: np.random.Generator) -> str:
    """One of `ENTRIES` done to a file, and its name."""
    how = ENTRIES[rng.integers(len(ENTRIES))]
    with h5py.File(path, "r+") as file:
        how(file, rng)
    return how.__name__


def change_bytes_of(path: Path, rng: np.random.Generator) -> str:
    """One of `BYTES` done to a file, and its name."""
    how = BYTES[rng.integers(len(BYTES))]
    path.write_bytes(how(bytearray(path.read_bytes()), rng))
    return how.__name__
