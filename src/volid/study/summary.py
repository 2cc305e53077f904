"""A study in a few numbers: bias, spread, coverage of every quantity, by machine, design and noise."""

from __future__ import annotations

from typing import Any

import numpy as np

from volid.backend.rms import rms
from volid.virtual.comparison import covered

FIELD = "deviation field"
SUMMARY: dict[str, tuple[type, str]] = {
    "machine": (str, ""),
    "design": (str, ""),
    "noise": (float, ""),
    "quantity": (str, ""),
    "campaigns": (int, ""),
    "failed": (int, ""),
    "rejected": (int, ""),
    "not_converged": (int, ""),
    "bias": (float, "mm or rad"),
    "spread": (float, "mm or rad"),
    "rms": (float, "mm or rad"),
    "u": (float, "mm or rad"),
    "coverage": (float, ""),
    "unit_weight": (float, ""),
    "seconds": (float, "s"),
}


def _known(values: Any) -> np.ndarray:
    """The values that are numbers."""
    values = np.asarray(values, dtype=float)
    return np.asarray(values[np.isfinite(values)])


def mean_of(values: Any) -> float:
    """Mean of the values that are not NaN; NaN when there is none."""
    kept = _known(values)
    return float(kept.mean()) if kept.size else float("nan")


def rms_of(values: Any) -> float:
    """Root mean square of the values that are not NaN."""
    return rms(_known(values))


def summary(records: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """`SUMMARY` of every machine, design and noise, for the deviation field and every function ("quantity").

    All numbers are over the N campaigns that did not fail, with d the difference of solution and truth at a place. bias = RMS
    over places of mean(d), itself uncertain by spread/sqrt(N); spread = RMS over places of the standard deviation of d; rms and u
    = RMS of d and of the stated u; coverage = share with |d| ≤ 1.96 u. Those of the deviation field are 3-D lengths. The truth
    differs from seed to seed unless the study fixes it.
    """
    groups: dict[tuple[str, str, float], list[dict[str, Any]]] = {}
    for record in records:
        groups.setdefault((record["machine"], record["design"], record["noise"]), []).append(record)
    rows = []
    for key, members in groups.items():
        good = [r for r in members if not r["error"]]
        common = {
            "campaigns": len(members),
            "failed": len(members) - len(good),
            "rejected": sum(r["rejected"] for r in good),
            "not_converged": sum(not r["converged"] for r in good),
            "unit_weight": mean_of([r["unit_weight"] for r in good]),
            "seconds": mean_of([r["seconds"] for r in good]),
        }
        for quantity in dict.fromkeys([FIELD, *(n for r in good for n in r["differences"])]):
            found = dict(zip(("machine", "design", "noise"), key, strict=True)) | common | _statistics(good, quantity)
            rows.append({name: found[name] for name in SUMMARY})
    return rows


def _statistics(records: list[dict[str, Any]], quantity: str) -> dict[str, Any]:
    """Bias, spread, RMS, u and coverage of one quantity; the three components of the field make one length."""
    factor = np.sqrt(3.0) if quantity == FIELD else 1.0
    d, u = (
        np.array([r[k][quantity] for r in records if quantity in r[k]], dtype=float) for k in ("differences", "u_of")
    )
    known = np.isfinite(d)
    n = known.sum(axis=0)
    mean = np.where(known, d, 0.0).sum(axis=0) / np.where(n > 0, n, np.nan)
    squares = np.where(known, (d - mean) ** 2, 0.0).sum(axis=0) / np.where(n > 1, n - 1, np.nan)
    return {
        "quantity": quantity,
        "bias": factor * rms_of(mean),
        "spread": factor * float(np.sqrt(mean_of(squares))),
        "rms": factor * rms_of(d),
        "u": factor * rms_of(u),
        "coverage": mean_of([c for x, s in zip(d, u, strict=True) for c in covered(x, s)]),
    }
