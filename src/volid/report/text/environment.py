"""What was done to readings for air and temperature, in words."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

from volid.effects.environment.factors import TYPICAL_U

_BODIES = {
    "machine": "scales of the machine at {} °C, reduced to 20 °C by",
    "artefact": "artefact at {} °C, longer than at 20 °C by",
}
_SENSORS = "0.1 °C, 0.3 hPa and 5 % of humidity"
assert TYPICAL_U == {"air_temperature_C": 0.1, "pressure_hPa": 0.3, "humidity_percent": 5.0}, "the words above"


def environment_words(account: dict[str, Any]) -> Iterator[str]:
    """An entry of `environment.remarks.accounts` in words, part by part."""
    if account["refractivity"] is not None:
        yield from _refraction(account)
    for name, words in _BODIES.items():
        if name in account:
            body = account[name]
            yield f"{words.format(_span(body['temperature'], 1.0, 1))} {_span(body['change'], 1e6, 2)} µm/m"


def _refraction(account: dict[str, Any]) -> Iterator[str]:
    size = f"{_span(account['refraction'], 1e6, 2)} µm/m"
    log = f"by the log '{account['environment']}'"
    if account["undone"]:
        yield f"correction by the instrument undone first, {1e6 * account['undone']:.2f} µm/m"
    yield f"refraction {size} applied, {log}" if account["applied"] else f"corrected by the instrument; {log} {size}"
    u = f"{1e6 * account['u_refraction']:.2g} µm/m"
    yield f"its u {u} is part of every u" if account["u_stated"] else f"no u of it is stated: {_SENSORS} make {u}"


def _span(values: Sequence[float], factor: float, digits: int) -> str:
    low, high = (f"{factor * value:.{digits}f}" for value in values)
    return low if low == high else f"{low} … {high}"
