"""What an HDF5 file may hold, checked before anything in it is read: its links, objects, types and sizes.

A file says itself how much memory its contents take and where they lie, other files included, so it is walked once first. Refused
are links that lead elsewhere (soft, external), cycles, virtual datasets and external storage, types other than numbers, texts and
truth values, foreign filters, and more values than the file can hold. Nothing outside the file is opened.

As a program of its own, `python hdf5_structure.py FILE SECONDS`, it also reads every value and prints what is wrong. It needs
h5py and NumPy alone, so that it starts fast (`volid.io.basics.hdf5_guard`).
"""

from __future__ import annotations

import math
import os
import sys
from collections.abc import Iterator

import h5py
import numpy as np
from h5py import h5a, h5d, h5g, h5l, h5o, h5t, h5z

DEPTH = 12  # groups within groups; volid writes 4
DIMENSIONS = 8
LONGEST = 2**20  # bytes of a text of fixed length
CHUNK = 2**26  # bytes of a chunk, which are read at once
EXPANSION, ROOM = 500, 2**26  # all values take at most EXPANSION · file size + ROOM bytes once they are read
PACKED = 1100  # largest factor of gzip is 1032
MEMORY = 3 * 2**28  # bytes, address space of the program of its own, of which h5py and NumPy take 0.12 GB
LARGEST_ITEM = 8  # bytes of a number
_HEAP = 16  # bytes of a text of any length where it stands in its dataset; the text itself lies in a heap of the file
BLOCK = 2**24  # bytes read at once when every value is read
_FILTERS = {h5z.FILTER_DEFLATE: "gzip", h5z.FILTER_SHUFFLE: "shuffle", h5z.FILTER_FLETCHER32: "Fletcher-32"}
_CLASSES = {
    h5t.COMPOUND: "compound values",
    h5t.REFERENCE: "references",
    h5t.VLEN: "lists of any length",
    h5t.ARRAY: "arrays of arrays",
    h5t.OPAQUE: "opaque values",
    h5t.TIME: "times",
    h5t.BITFIELD: "bit fields",
    h5t.ENUM: "an enumeration",
}


class Unfit(Exception):
    """The file holds what cannot be read safely; the text names place, what was found and what was expected."""


class _Budget:
    """Bytes that the contents may still take: stored ones, and values in memory."""

    def __init__(self, size: int) -> None:
        self.size, self.stored, self.values = size, size, EXPANSION * size + ROOM

    def take(self, where: str, stored: int, values: int) -> None:
        self.stored -= stored
        self.values -= values
        if self.stored < 0 or self.values < 0 or values > PACKED * stored + LONGEST:
            raise Unfit(
                f"{where}: its values would take {values} bytes; expected no more than a file of {self.size} bytes can hold"
            )


def shown(name: str) -> str:
    """A name from a file for a message: no control characters, at most 80 characters."""
    text = "".join(c if c.isprintable() else ascii(c)[1:-1] for c in name)
    return text if len(text) <= 80 else text[:77] + "…"


def check_structure(file: h5py.File, size: int) -> None:
    """Walk an open file of `size` bytes. Raises `Unfit` for what cannot be read safely."""
    for _ in datasets(file, size):
        pass


def datasets(file: h5py.File, size: int) -> Iterator[tuple[str, h5d.DatasetID]]:
    """Every dataset of an open file with its place, each checked; groups, links and attributes are checked on the way.

    Raises `Unfit` for what cannot be read safely.
    """
    budget, seen = _Budget(size), set()
    root = h5g.open(file.id, b"/")
    waiting = [("", root, 0)]
    seen.add(h5o.get_info(root).addr)
    while waiting:
        place, group, depth = waiting.pop()
        _check_attributes(place or "/", group, budget)
        for name in _names(place, group):
            where = f"{place}/{shown(name.decode('utf-8', 'surrogateescape'))}"
            kind = h5o.get_info(group, name).type
            found = h5o.open(group, name)
            if kind == h5o.TYPE_DATASET:
                _check_attributes(where, found, budget)
                _check_dataset(where, found, budget)
                yield where, found
                continue
            if kind != h5o.TYPE_GROUP:
                raise Unfit(f"{where} is a named type; expected groups and datasets")
            address = h5o.get_info(found).addr
            if address in seen or depth >= DEPTH:
                why = (
                    "is a group that stands in several places" if address in seen else f"is deeper than {DEPTH} groups"
                )
                raise Unfit(f"{where} {why}; expected groups as volid writes them")
            seen.add(address)
            waiting.append((where, found, depth + 1))


def _names(place: str, group: h5g.GroupID) -> list[bytes]:
    names = list(group)
    for name in names:
        kind = group.links.get_info(name).type
        if kind != h5l.TYPE_HARD:
            words = {h5l.TYPE_SOFT: "a soft link", h5l.TYPE_EXTERNAL: "a link to another file"}.get(
                kind, "a foreign link"
            )
            where = shown(name.decode("utf-8", "surrogateescape"))
            raise Unfit(f"{place}/{where} is {words}; expected the contents themselves, volid follows no links")
    return names


def _check_attributes(where: str, item: h5g.GroupID | h5d.DatasetID, budget: _Budget) -> None:
    for i in range(h5a.get_num_attrs(item)):
        attribute = h5a.open(item, index=i)
        place = f"{where}, attribute {shown(attribute.name.decode('utf-8', 'surrogateescape'))}"
        kind = attribute.get_type()
        _check_type(place, kind)
        count = math.prod(attribute.shape or ())
        budget.take(place, 0, 0)
        if count * kind.get_size() > budget.size:
            raise Unfit(f"{place}: holds {count} values; expected no more than the file can hold")


def _check_type(where: str, kind: h5t.TypeID) -> None:
    number = kind.get_class()
    if number in (h5t.INTEGER, h5t.FLOAT) and kind.get_size() <= LARGEST_ITEM:
        return
    if number == h5t.STRING:
        if not kind.is_variable_str() and kind.get_size() > LONGEST:
            raise Unfit(f"{where}: texts have {kind.get_size()} bytes each; expected at most {LONGEST}")
        return
    if number == h5t.ENUM and kind.get_size() == 1 and kind.get_nmembers() == 2:
        return
    words = _CLASSES.get(number, f"numbers of {kind.get_size()} bytes")
    raise Unfit(f"{where}: holds {words}; expected numbers, texts or truth values")


def _check_dataset(where: str, dataset: h5d.DatasetID, budget: _Budget) -> None:
    plan = dataset.get_create_plist()
    if plan.get_external_count():
        raise Unfit(f"{where}: its values lie in another file; expected them in this one")
    if plan.get_layout() == h5d.VIRTUAL:
        raise Unfit(f"{where} is a virtual dataset; expected its values in this file")
    for i in range(plan.get_nfilters()):
        code = plan.get_filter(i)[0]
        if code not in _FILTERS:
            raise Unfit(f"{where}: is packed by filter {code}; expected {', '.join(_FILTERS.values())} or none")
    kind = dataset.get_type()
    _check_type(where, kind)
    shape, item = dataset.shape, _HEAP if kind.get_class() == h5t.STRING and kind.is_variable_str() else kind.get_size()
    if shape is None:
        raise Unfit(f"{where}: is empty, without shape; expected values")
    if len(shape) > DIMENSIONS:
        raise Unfit(f"{where}: has {len(shape)} dimensions; expected at most {DIMENSIONS}")
    values, stored = math.prod(shape) * item, dataset.get_storage_size()
    budget.take(where, stored, values)
    if plan.get_layout() == h5d.CHUNKED:
        _check_chunks(where, dataset, plan.get_chunk(), item)
    elif values != stored:
        raise Unfit(f"{where}: {stored} bytes are stored; expected {values} for shape {shape}")


def _check_chunks(where: str, dataset: h5d.DatasetID, chunk: tuple[int, ...], item: int) -> None:
    """Every chunk is small enough to be read, and stands in the file: none is filled in."""
    if math.prod(chunk) * item > CHUNK:
        raise Unfit(f"{where}: a chunk has {math.prod(chunk) * item} bytes; expected at most {CHUNK}")
    expected = math.prod(-(-n // c) for n, c in zip(dataset.shape, chunk, strict=True))
    found = dataset.get_num_chunks() if expected else 0
    if found != expected:
        raise Unfit(f"{where}: {found} chunks are stored; expected {expected} for shape {dataset.shape}")


# ------------------------------------------------------------------------------------------------ as a program of its own


def read_everything(path: str) -> None:
    """Open a file, check it, and read every value and attribute of it, part by part. Raises `Unfit`, or what h5py raises."""
    with h5py.File(path, "r") as file:
        for _, identifier in datasets(file, os.path.getsize(path)):
            dataset = h5py.Dataset(identifier)
            dict(dataset.attrs)
            for part in _parts(dataset):
                dataset[part]
        dict(file.attrs)
        file.visititems(lambda _, item: dict(item.attrs) and None)


def _parts(dataset: h5py.Dataset) -> Iterator[slice | tuple[()]]:
    if not dataset.shape:
        yield ()
        return
    rows = max(1, BLOCK // max(1, dataset.dtype.itemsize * math.prod(dataset.shape[1:])))
    yield from (slice(start, start + rows) for start in range(0, dataset.shape[0], rows))


def limit(memory: int, seconds: int) -> None:
    """No more than so many bytes of memory and seconds of processor time for this process, where the system can set a limit."""
    try:
        import resource
    except ImportError:  # Windows
        return
    resource.setrlimit(resource.RLIMIT_AS, (memory, memory))
    resource.setrlimit(resource.RLIMIT_CPU, (seconds, seconds))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))


def main(path: str, seconds: str) -> int:
    """Print what is wrong with a file that can be read in so many seconds of processor time; 0 when nothing is."""
    try:
        limit(MEMORY, int(seconds))
        read_everything(path)
    except Unfit as error:
        print(f"unfit {error}")
        return 1
    except Exception as error:  # whatever the library makes of a damaged file
        print(f"damaged {shown(str(error))}")
        return 1
    return 0


if __name__ == "__main__":
    np.seterr(all="ignore")
    sys.exit(main(*sys.argv[1:3]))
