"""Dataclasses that JAX sees as trees of arrays: `@register_dataclass @dataclass(frozen=True)`, settings marked `STATIC`.

JAX has to be told of such a class before it meets an object of it, but is imported only where it is needed. A class is therefore
registered at once when JAX is there, and waits otherwise. Those that wait are registered (`register_waiting`) when volid itself
first uses JAX (`volid.backend.lazy`), and when a solution or a machine, which users hand to JAX, is made or read while JAX is
imported. One case is left: a solution made before the user's own `import jax`, and handed to JAX before volid has used JAX. JAX
does not take it for a tree then; `import jax` at the top of a script, any call of `solution.deviation`, or `register_waiting()`
avoids that.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import fields, replace
from importlib import import_module
from threading import Lock
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, TypeVar

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

STATIC = MappingProxyType({"static": True})
"""Metadata of a field that is no array: `field(metadata=STATIC)`. In trees that compiled programs take it is hashable, and
part of their key."""

T = TypeVar("T")
D = TypeVar("D", bound="DataclassInstance")
_waiting: list[type] = []
_lock = Lock()


def register_dataclass(kind: type[T]) -> type[T]:
    """As `jax.tree_util.register_dataclass`, without importing JAX."""
    _waiting.append(kind)
    register_if_imported()
    return kind


def register_if_imported() -> None:
    """Register what waits when JAX has been imported; quick otherwise."""
    if _waiting and "jax" in sys.modules:
        register_waiting()


def register_waiting() -> None:
    """Import JAX, and make every class known to it that waits. Any thread may call this at any time."""
    jax_trees = import_module("jax.tree_util")  # where another thread imports JAX at this moment, Python waits here
    with _lock:
        while _waiting:
            jax_trees.register_dataclass(_waiting.pop())


def map_arrays(function: Callable[[Any], Any], tree: D) -> D:
    """`tree` with `function` of every field that is not `STATIC`, all of them arrays: as `jax.tree.map`, without JAX."""
    arrays = [f.name for f in fields(tree) if not f.metadata.get("static")]
    return replace(tree, **{name: function(getattr(tree, name)) for name in arrays})
