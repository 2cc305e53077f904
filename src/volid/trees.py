"""Dataclasses that JAX sees as trees of arrays: `@register_dataclass @dataclass(frozen=True)`, settings marked `STATIC`."""

from __future__ import annotations

from types import MappingProxyType

STATIC = MappingProxyType({"static": True})
"""Metadata of a field that is no array: `field(metadata=STATIC)`. In trees that compiled programs take it is hashable, and
part of their key."""
