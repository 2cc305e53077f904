"""The evaluation of diagonals after ISO 230-6: E, R and B of each, and the largest of them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from volid.standards.diagonals.lines import BODY_NAMES, FACE_NAMES, Diagonal
from volid.standards.positioning.evaluation import quantities_of
from volid.standards.positioning.rules import APPROACHES
from volid.standards.positioning.runs import WAY_NAMES, ask_size, statistics_of
from volid.standards.positioning.uncertainty import PROBABILITY, Contribution, expanded
from volid.standards.results import Evaluation, Quantity, Table

STANDARD = "ISO 230-6"
BODY, FACE = "body", "face"
SYMBOLS = {"E": "systematic deviation, both ways", "R": "repeatability, both ways", "B": "reversal, the largest"}
ONE_WAY = {"E": "systematic deviation", "R": "repeatability"}  # of a diagonal that was run one way only
WORDS = {"up": "on the way on", "down": "on the way back"}
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
    by_symbol = [found for d in diagonals for found in _quantities(d)]
    singles = [q for _, q in by_symbol]
    return Evaluation(
        STANDARD,
        subject,
        (*singles, *_largest(by_symbol, diagonals, subject)),
        tuple(_remarks(subject, diagonals, singles)),
        table=Table(COLUMNS, tuple(row for d in diagonals for row in _rows(d))),
        source=source or diagonals[0].runs.source.partition(",")[0],
        details=tuple(diagonals),
    )


def _quantities(diagonal: Diagonal) -> Iterator[tuple[str, Quantity]]:
    """E, R and B of one diagonal, or E_up … of one way, with U where something is known of its uncertainty."""
    ask_size(diagonal.runs)
    values, U = quantities_of(statistics_of(diagonal.runs.deviations)), _U(diagonal)
    for symbol, text in _symbols(diagonal).items():
        if np.isfinite(values[symbol]):
            name, words = f"{symbol}_{diagonal.name}", f"{text}, along {diagonal.name}"
            yield symbol, Quantity(name, float(values[symbol]), "mm", U.get(symbol), text=words)


def _symbols(diagonal: Diagonal) -> dict[str, str]:
    """What is determined of a diagonal, with its words."""
    if len(diagonal.runs.directions) > 1:
        return SYMBOLS
    way = WAY_NAMES[diagonal.runs.directions[0]]
    return {f"{symbol}_{way}": f"{text}, {WORDS[way]}" for symbol, text in ONE_WAY.items()}


def _U(diagonal: Diagonal, probability: float = PROBABILITY) -> Mapping[str, float]:
    """U by symbol of ISO 230-2; none where nothing is known of the uncertainty."""
    known = diagonal.contributions
    return expanded(diagonal.runs, known, quantities_of, probability=probability).U if known else {}


def _largest(
    by_symbol: Sequence[tuple[str, Quantity]], diagonals: Sequence[Diagonal], subject: str
) -> Iterator[Quantity]:
    """E_d, R_d, B_d: the largest of the diagonals; E_up_d … of diagonals that were run one way.

    The largest of several changes by no more than one of them, and with k = 2 (95.45 %) none of n diagonals changes by more than
    its U for the probability 0.9545^(1/n): the largest of these is U. Noise raises the largest of alike diagonals; that is in it.
    """
    found = [_U(d, PROBABILITY ** (1.0 / len(diagonals))) for d in diagonals]
    for symbol in dict.fromkeys(symbol for symbol, _ in by_symbol):
        own = [q for of, q in by_symbol if of == symbol]
        largest = max(own, key=lambda q: q.value)
        known = [U[symbol] for U in found if symbol in U]
        U = max(known) if len(known) == len(own) else None
        yield Quantity(
            f"{symbol}_d", largest.value, "mm", U, text=f"largest of the {subject} diagonals: {largest.symbol}"
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
        yield (
            f"run one way only: {', '.join(alone)}; E, R and B hold for both ways and are not determined, those of "
            "the way it was run, E_up or E_down, hold"
        )
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
