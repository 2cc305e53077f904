"""JAX, imported when it is first used: importing it takes as long as a fit of some thousand readings, which does without.

`jax` and `jnp` stand for the modules, `jit` for `jax.jit` on functions at the top of a module. Any thread may be the first to use
them. Raise `ImportError` at the first use where JAX cannot be imported.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache, wraps
from importlib import import_module
from types import ModuleType
from typing import TYPE_CHECKING, Any

from volid.backend.pytrees import register_waiting

if TYPE_CHECKING:
    import jax as jax
    import jax.numpy as jnp
else:

    class _OnDemand(ModuleType):
        """Stands for a module that is imported when something in it is asked for; volid's trees are then known to JAX.

        The package first: threads that begin with different modules of it would wait for each other.
        """

        def __getattr__(self, name: str) -> Any:
            import_module(self.__name__.partition(".")[0])
            register_waiting()
            value = getattr(import_module(self.__name__), name)
            setattr(self, name, value)  # asked for once
            return value

    jax, jnp = _OnDemand("jax"), _OnDemand("jax.numpy")


def jit(function: Callable[..., Any], **options: Any) -> Callable[..., Any]:
    """As `jax.jit`, without importing JAX before the first call."""

    @cache
    def compiled() -> Callable[..., Any]:
        return jax.jit(function, **options)

    @wraps(function)
    def call(*args: Any, **kwargs: Any) -> Any:
        return compiled()(*args, **kwargs)

    return call
