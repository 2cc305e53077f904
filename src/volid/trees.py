"""Dataclasses that JAX sees as trees of arrays: `@register_dataclass @dataclass(frozen=True)`, settings marked `STATIC`."""

from __future__ import annotations

from types import MappingProxyType

STATIC = MappingProxyType({"static": True})
"""Metadata of a field that is no array, hashable, and part of the key of a compiled program: `field(metadata=STATIC)`."""
