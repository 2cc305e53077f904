"""JAX, imported when it is first used: importing it takes as long as a fit of some thousand readings, which does without.

`jax` and `jnp` stand for the modules, `jit` for `jax.jit` on functions at the top of a module. Any thread may be the first to use
them. Raise `ImportError` at the first use where JAX cannot be imported.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property, update_wrapper
from importlib import import_module
from types import ModuleType
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import jax as jax
    import jax.numpy as jnp
else:

    class _OnDemand(ModuleType):
        """Stands for a module that is imported when something in it is asked for.

        The package first: threads that begin with different modules of it would wait for each other.
        """

        def __getattr__(self, name: str) -> Any:
            import_module(self.__name__.partition(".")[0])
            value = getattr(import_module(self.__name__), name)
            setattr(self, name, value)  # asked for once
            return value

    jax, jnp = _OnDemand("jax"), _OnDemand("jax.numpy")


class Program:
    """A function that is compiled by JAX when it is first called; everything else is asked of the compiled one."""

    def __init__(self, function: Callable[..., Any], **options: Any) -> None:
        self._function, self._options = function, options
        update_wrapper(self, function)

    def __reduce__(self) -> str:
        return str(self._function.__qualname__)

    @cached_property
    def _compiled(self) -> Any:
        return jax.jit(self._function, **self._options)

    def __call__(self, *args: Any, **kwargs: Any) -> Any:
        """The function's value."""
        return self._compiled(*args, **kwargs)

    def __getattr__(self, name: str) -> Any:
        if name.startswith("_"):  # also what is set in `__init__` and not there yet
            raise AttributeError(name)
        return getattr(self._compiled, name)


def jit(function: Callable[..., Any], **options: Any) -> Program:
    """`jax.jit`, without importing JAX."""
    return Program(function, **options)
