"""The evaluation of diagonals after ISO 230-6: E, R and B of each, and the largest of them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from volid.standards.diagonals.lines import BODY_NAMES, FACE_NAMES, Diagonal
from volid.standards.positioning.evaluation import quantities_of
from volid.standards.positioning.rules import APPROACHES
from volid.standards.positioning.runs import statistics_of
from volid.standards.positioning.uncertainty import PROBABILITY, Contribution, expanded
from volid.standards.results import Evaluation, Quantity, Table

STANDARD = "ISO 230-6"
BODY, FACE = "body", "face"
SYMBOLS = {"E": "systematic deviation, both ways", "R": "repeatability, both ways", "B": "reversal, the largest"}
COLUMNS = ("diagonal", "target_mm", "mean_up_mm", "mean_down_mm", "s_up_mm", "s_down_mm", "B_mm")
MIXED = (
    "a diagonal mixes the errors of all axes, and opposite ones hide each other: small diagonals do not prove a small "
    "volumetric error"
)


def evaluate_diagonals(diagonals: Sequence[Diagonal], source: str = "") -> list[Evaluation]:
    """One evaluation of the body diagonals and one of the face diagonals, as far as they were measured.

    Args:
        diagonals: Diagonals of one set or file.
        source: Where they come from, for the reader.

    >>> from volid.standards.positioning.runs import from_means
    >>> ways = {1: np.array([0.0, 0.004]), -1: np.array([-0.001, 0.002])}
    >>> runs = from_means("PPP", np.array([0.0, 700.0]), ways)
    >>> (found,) = evaluate_diagonals([Diagonal("PPP", True, runs)])
    >>> round(found["E_PPP"].value, 6), round(found["B_d"].value, 6)
    (0.005, 0.002)
    """
    parts = {BODY: [d for d in diagonals if d.is_body], FACE: [d for d in diagonals if not d.is_body]}
    return [_evaluation(subject, own, source) for subject, own in parts.items() if own]


def _evaluation(subject: str, diagonals: Sequence[Diagonal], source: str) -> Evaluation:
    singles = [q for d in diagonals for q in _quantities(d)]
    return Evaluation(
        STANDARD,
        subject,
        (*singles, *_largest(singles, diagonals, subject)),
        tuple(_remarks(subject, diagonals, singles)),
        table=Table(COLUMNS, tuple(row for d in diagonals for row in _rows(d))),
        source=source or diagonals[0].runs.source.partition(",")[0],
        details=tuple(diagonals),
    )


def _quantities(diagonal: Diagonal) -> Iterator[Quantity]:
    """E, R and B of one diagonal, with U where something is known of its uncertainty."""
    values, U = quantities_of(statistics_of(diagonal.runs.deviations)), _U(diagonal)
    for symbol, text in SYMBOLS.items():
        if np.isfinite(values[symbol]):
            name = f"{symbol}_{diagonal.name}"
            yield Quantity(name, float(values[symbol]), "mm", U.get(symbol), text=f"{text}, along {diagonal.name}")


def _U(diagonal: Diagonal, probability: float = PROBABILITY) -> Mapping[str, float]:
    """U by symbol of ISO 230-2; none where nothing is known of the uncertainty."""
    known = diagonal.contributions
    return expanded(diagonal.runs, known, quantities_of, probability=probability).U if known else {}


def _largest(singles: Sequence[Quantity], diagonals: Sequence[Diagonal], subject: str) -> Iterator[Quantity]:
    """E_d, R_d, B_d: the largest of the diagonals.

    The largest of several changes by no more than one of them, and with k = 2 (95.45 %) none of n diagonals changes by more than
    its U for the probability 0.9545^(1/n): the largest of these is U. Noise raises the largest of alike diagonals; that is in it.
    """
    found = [_U(d, PROBABILITY ** (1.0 / len(diagonals))) for d in diagonals]
    for symbol in SYMBOLS:
        own = [q for q in singles if q.symbol.startswith(f"{symbol}_")]
        if own:
            largest = max(own, key=lambda q: q.value)
            known = [U[symbol] for U in found if symbol in U]
            text = f"largest of the {subject} diagonals: {largest.symbol}"
            yield Quantity(
                f"{symbol}_d", largest.value, "mm", max(known) if len(known) == len(own) else None, text=text
            )


def _remarks(subject: str, diagonals: Sequence[Diagonal], singles: Sequence[Quantity]) -> Iterator[str]:
    wanted = BODY_NAMES if subject == BODY else FACE_NAMES
    missing = [name for name in wanted if name not in {d.name for d in diagonals}]
    if missing:
        yield f"not measured: {', '.join(missing)}; E_d, R_d and B_d are of the others"
    counts = [statistics_of(d.runs.deviations).n[:, list(d.runs.directions)].min() for d in diagonals]
    if any(d.runs.are_means for d in diagonals):
        yield "only means are known, not the approaches they come from: R is not determined"
    elif min(counts) < APPROACHES:
        lost = "; of one approach R is not determined" if min(counts) < 2 else ""
        yield f"{min(counts)} approach(es) of each target and way; ISO 230-6 follows ISO 230-2 and asks for {APPROACHES}{lost}"
    alone = [d.name for d in diagonals if len(d.runs.directions) < 2]
    if alone:
        yield f"run one way only: {', '.join(alone)}; E, R and B hold for both ways and are not determined"
    yield from dict.fromkeys(note for d in diagonals for note in d.runs.notes)
    if singles:
        yield MIXED


def _rows(diagonal: Diagonal) -> Iterator[tuple[str | float, ...]]:
    found = statistics_of(diagonal.runs.deviations)
    columns = np.column_stack([diagonal.runs.targets, found.mean, found.s, found.reversal])
    for row in columns.tolist():
        yield diagonal.name, *row


def contributions_from(u: float, diagonal: Diagonal) -> Contribution:
    """Noise of standard uncertainty `u` of every reading [mm]."""
    shape = diagonal.runs.deviations.shape
    return Contribution("u of the readings", lambda rng, trials: u * rng.standard_normal((trials, *shape)))
