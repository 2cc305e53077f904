"""Dataclasses that JAX sees as trees of arrays: `@register_dataclass @dataclass(frozen=True)`, settings marked `STATIC`.

They are made known to JAX when it is there, or as soon as anyone imports it.
"""

from __future__ import annotations

import importlib.util
import sys
import threading
from collections.abc import Callable
from dataclasses import fields, replace
from functools import partial
from importlib.abc import MetaPathFinder
from importlib.machinery import ModuleSpec
from types import MappingProxyType, ModuleType
from typing import TYPE_CHECKING, Any, TypeVar

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

STATIC = MappingProxyType({"static": True})
"""Metadata of a field that is no array: `field(metadata=STATIC)`. In trees that compiled programs take it is hashable, and
part of their key."""

T = TypeVar("T")
D = TypeVar("D", bound="DataclassInstance")
_waiting: list[type] = []


def register_dataclass(kind: type[T]) -> type[T]:
    """As `jax.tree_util.register_dataclass`, without importing JAX."""
    if "jax" in sys.modules:  # where another thread imports it at this moment, Python waits here until that is done
        from jax.tree_util import register_dataclass as register

        register(kind)
    else:
        _waiting.append(kind)
        if not any(isinstance(finder, _WhenJaxComes) for finder in sys.meta_path):
            sys.meta_path.insert(0, _WhenJaxComes())
    return kind


def map_arrays(function: Callable[[Any], Any], tree: D) -> D:
    """`tree` with `function` of every field that is not `STATIC`, all of them arrays: as `jax.tree.map`, without JAX."""
    arrays = [f.name for f in fields(tree) if not f.metadata.get("static")]
    return replace(tree, **{name: function(getattr(tree, name)) for name in arrays})


class _WhenJaxComes(MetaPathFinder):
    """Finds nothing itself; makes the loader of JAX register what waits for it, whenever it is really imported."""

    def __init__(self) -> None:
        self._asking = threading.local()

    def find_spec(self, name: str, path: Any, target: ModuleType | None = None) -> ModuleSpec | None:
        """The specification of `jax` with a loader that registers afterwards; None for everything else."""
        if name != "jax" or getattr(self._asking, "now", False):
            return None
        self._asking.now = True
        try:
            spec = importlib.util.find_spec(name)
        finally:
            self._asking.now = False
        if spec is not None and spec.loader is not None:
            spec.loader.exec_module = partial(_execute, spec.loader.exec_module)  # type: ignore[method-assign]
        return spec


def _execute(execute: Callable[[ModuleType], None], module: ModuleType) -> None:
    """Import JAX, then tell it what has waited."""
    execute(module)
    while _waiting:
        module.tree_util.register_dataclass(_waiting.pop())
