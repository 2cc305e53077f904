"""Readings that come part by part, reduced like those of a campaign in memory."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from volid.campaign import Campaign
from volid.effects.environment.reduction import reduced


class ReducedStream:
    """A stream of campaigns (`fitting.streamed.Stream`) whose parts are reduced with the dead paths that a sample tells."""

    def __init__(self, stream: Any, starts: Mapping[Any, float]) -> None:
        self.stream, self.starts = stream, starts
        self.rows: int = stream.rows
        self.n_readings: int = stream.n_readings

    def parts(self) -> Iterator[Campaign]:
        """All readings, reduced."""
        return (reduced(part, self.starts) for part in self.stream.parts())

    def sample(self, rows: int) -> Campaign:
        """About so many rows, reduced."""
        return reduced(self.stream.sample(rows), self.starts)
