"""Dataclasses that JAX sees as trees of arrays: `@register_dataclass @dataclass(frozen=True)`, settings marked `STATIC`.

They are made known to JAX when it is there, or as soon as anyone imports it.
"""

from __future__ import annotations

import importlib.util
import sys
from collections.abc import Callable
from dataclasses import fields, replace
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
    if _is_there():
        from jax.tree_util import register_dataclass as register

        register(kind)
    else:
        if not _waiting:
            sys.meta_path.insert(0, _WhenJaxComes())
        _waiting.append(kind)
    return kind


def map_arrays(function: Callable[[Any], Any], tree: D) -> D:
    """`tree` with `function` of every field that is not `STATIC`, all of them arrays: as `jax.tree.map`, without JAX."""
    arrays = [f.name for f in fields(tree) if not f.metadata.get("static")]
    return replace(tree, **{name: function(getattr(tree, name)) for name in arrays})


def _is_there() -> bool:
    """Whether JAX has been imported to the end."""
    return hasattr(sys.modules.get("jax.tree_util"), "register_dataclass")


class _WhenJaxComes(MetaPathFinder):
    """Finds nothing itself; makes the loader of JAX register what waits for it."""

    def find_spec(self, name: str, path: Any, target: ModuleType | None = None) -> ModuleSpec | None:
        """The specification of `jax` with a loader that registers afterwards; None for everything else."""
        if name != "jax":
            return None
        sys.meta_path.remove(self)
        spec = importlib.util.find_spec(name)
        if spec is None or spec.loader is None:
            return spec
        loader = spec.loader
        execute = loader.exec_module

        def execute_and_register(module: ModuleType) -> None:
            execute(module)
            while _waiting:
                module.tree_util.register_dataclass(_waiting.pop())

        loader.exec_module = execute_and_register  # type: ignore[method-assign]
        return spec
