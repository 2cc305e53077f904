"""Flat, nearly flat and symmetric distance networks: is the result the lowest minimum that SciPy finds from many starts?

    python -m benchmarks.networks --networks 1000

Each network is random: stations, unknown points, u, noise, and approximate coordinates that may be good, rough, or exactly in the
plane. SciPy's `least_squares` (trust region, reflective) gets a residual of its own, written here, the given start, the truth,
their mirror images, the plane, and random places. Right: chi-square is at most that of the best of all its starts plus 1e-4,
or plus 0.01 where all approximate coordinates lie in one plane and the result stays there; and where both have the same, the
coordinates that are said to be determined agree to a hundredth of the u of a distance or a thousandth of their own, or are
those of a named second solution.
"""

from __future__ import annotations

import argparse
from collections import Counter
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from scipy.optimize import least_squares

from volid.multilateration import NetworkSolution, adjust_network


class Network(NamedTuple):
    """Names by number; `fixed` is the number of leading points that are; truth and approximate coordinates (p, d)."""

    kind: str
    fixed: int
    truth: np.ndarray
    approximate: np.ndarray
    observations: list[tuple[int, int, float]]
    u: float


def _observed(
    rng: np.random.Generator, truth: np.ndarray, pairs: list[tuple[int, int]], u: float
) -> list[tuple[int, int, float]]:
    return [(a, b, float(np.linalg.norm(truth[a] - truth[b]) + u * rng.normal())) for a, b in pairs]


def _tilted(rng: np.random.Generator, *places: np.ndarray) -> list[np.ndarray]:
    """The same places turned at random and shifted in half of the networks, else as they are."""
    if rng.random() < 0.5:
        return list(places)
    turn, shift = (
        np.linalg.qr(rng.normal(size=(places[0].shape[1],) * 2))[0],
        rng.normal(size=places[0].shape[1]) * 1000,
    )
    return [place @ turn + shift for place in places]


def _stations(rng: np.random.Generator, count: int, out: float) -> np.ndarray:
    return np.column_stack([rng.uniform(0, 5000, count), rng.uniform(0, 9000, count), out * rng.uniform(-1, 1, count)])


def _start(rng: np.random.Generator, truth: np.ndarray) -> np.ndarray:
    """Right within a millimetre, within a metre, or right but for the height, which is 0."""
    choice = rng.integers(3)
    if choice == 2:
        return truth * [1, 1, 0] + [*(rng.normal(size=2) * 5), 0]
    return truth + rng.normal(size=truth.shape) * (1.0 if choice == 0 else 1000.0)


def one_point(rng: np.random.Generator, out: float, height: float, kind: str) -> Network:
    """One point, three to six stations on one floor (`out`: how far from it), at a height up to `height`."""
    stations = _stations(rng, int(rng.integers(3, 7)), out)
    target = np.array([[rng.uniform(0, 5000), rng.uniform(0, 9000), height * rng.uniform(-1, 1)]])
    truth, start = np.vstack([stations, target]), np.vstack([stations, _start(rng, target)])
    truth, start = _tilted(rng, truth, start)
    u = 10 ** rng.uniform(-3, -1)
    count = len(stations)
    return Network(kind, count, truth, start, _observed(rng, truth, [(i, count) for i in range(count)], u), u)


def flat_stations(rng: np.random.Generator) -> Network:
    """Stations in one plane, point in it or within 20 mm of it."""
    return one_point(rng, 0.0, rng.choice([0.0, 20.0]), "point in the plane of its stations")


def nearly_flat_stations(rng: np.random.Generator) -> Network:
    """Stations 1 to 20 mm out of one plane, point near it."""
    return one_point(rng, rng.uniform(1, 20), 20.0, "stations 1 to 20 mm out of plane")


def symmetric(rng: np.random.Generator) -> Network:
    """Point up to 3 m above or below its stations."""
    return one_point(rng, 0.0, 3000.0, "point above coplanar stations")


def several_points(rng: np.random.Generator) -> Network:
    """Two to four points near the plane of three to five stations, with distances between them."""
    stations, count = _stations(rng, int(rng.integers(3, 6)), 0.0), int(rng.integers(2, 5))
    target = np.column_stack(
        [rng.uniform(0, 5000, count), rng.uniform(0, 9000, count), rng.choice([10.0, 1500.0]) * rng.normal(size=count)]
    )
    truth, start = np.vstack([stations, target]), np.vstack([stations, _start(rng, target)])
    truth, start = _tilted(rng, truth, start)
    s, p = len(stations), len(truth)
    pairs = [(i, j) for i in range(s) for j in range(s, p)] + [(i, j) for i in range(s, p) for j in range(i + 1, p)]
    u = 10 ** rng.uniform(-3, -1)
    return Network("several points, distances between them", s, truth, start, _observed(rng, truth, pairs, u), u)


def free_flat(rng: np.random.Generator) -> Network:
    """Five to eight points in one plane or within 5 mm of it, none fixed, all distances or most."""
    count = int(rng.integers(5, 9))
    truth = _stations(rng, count, rng.choice([0.0, 5.0]))
    start = truth + rng.normal(size=truth.shape) * rng.choice([[1.0, 1.0, 1.0], [1.0, 1.0, 0.0], [50.0, 50.0, 50.0]])
    if rng.random() < 0.5:
        start[:, 2] = 0.0
    pairs = [(i, j) for i in range(count) for j in range(i + 1, count) if count < 7 or rng.random() < 0.85]
    truth, start = _tilted(rng, truth, start)
    u = 10 ** rng.uniform(-3, -1)
    return Network("free network in one plane", 0, truth, start, _observed(rng, truth, pairs, u), u)


def collinear(rng: np.random.Generator) -> Network:
    """In the plane: three to six anchors nearly on a line, the start anywhere, often on the wrong side."""
    count = int(rng.integers(3, 7))
    anchors = np.column_stack(
        [rng.uniform(-10000, 16000, count), rng.normal(size=count) * rng.choice([0.0, 20.0, 300.0])]
    )
    target = np.array([[rng.uniform(-5000, 10000), rng.uniform(-5000, 5000)]])
    truth = np.vstack([anchors, target])
    start = np.vstack([anchors, [[rng.uniform(-5000, 10000), rng.uniform(-5000, 5000)]]])
    truth, start = _tilted(rng, truth, start)
    u = 10 ** rng.uniform(-2, 0)
    return Network(
        "nearly collinear anchors, start anywhere",
        count,
        truth,
        start,
        _observed(rng, truth, [(i, count) for i in range(count)], u),
        u,
    )


KINDS: tuple[Callable[[np.random.Generator], Network], ...] = (
    flat_stations,
    nearly_flat_stations,
    symmetric,
    several_points,
    free_flat,
    collinear,
)


def scipy_best(network: Network, seed: int, starts: int = 12) -> tuple[float, np.ndarray]:
    """Least chi-square of SciPy from many starts, and its coordinates (p, d)."""
    fixed, d = network.truth[: network.fixed], network.truth.shape[1]
    a, b = (np.array([row[k] for row in network.observations]) for k in (0, 1))
    readings, rng = np.array([row[2] for row in network.observations]), np.random.default_rng(seed)
    centre = network.truth.mean(axis=0)
    normal = np.linalg.svd((fixed if len(fixed) >= d else network.truth) - centre)[2][-1]

    def residuals(y: np.ndarray) -> np.ndarray:
        x = np.vstack([fixed, y.reshape(-1, d)])
        return (readings - np.sqrt(((x[b] - x[a]) ** 2).sum(axis=1))) / network.u

    def jacobian(y: np.ndarray) -> np.ndarray:
        x, rows = np.vstack([fixed, y.reshape(-1, d)]), np.arange(len(a))
        e = (x[b] - x[a]) / np.linalg.norm(x[b] - x[a], axis=1)[:, None] / network.u
        full = np.zeros((len(a), *x.shape))
        full[rows, b], full[rows, a] = -e, e
        return full[:, len(fixed) :].reshape(len(a), -1)

    places = [network.approximate, network.truth]
    places += [x - 2 * np.outer((x - centre) @ normal, normal) for x in places]
    places += [x - np.outer((x - centre) @ normal, normal) + 3 * side * normal for x in places[:2] for side in (1, -1)]
    size = np.linalg.norm(network.truth - centre, axis=1).max()
    places += [
        network.truth + rng.normal(size=network.truth.shape) * size * 10 ** rng.uniform(-3, 0) for _ in range(starts)
    ]
    best = (np.inf, network.truth)
    for place in places:
        found = least_squares(
            residuals, place[len(fixed) :].ravel(), jacobian, ftol=1e-15, xtol=1e-15, gtol=1e-15, max_nfev=400
        )
        if 2 * found.cost < best[0]:
            best = (2 * found.cost, np.vstack([fixed, found.x.reshape(-1, d)]))
    return best


def chi_square(network: Network, x: np.ndarray) -> float:
    """Sum of squared residuals over u."""
    return sum(((d - np.linalg.norm(x[a] - x[b])) / network.u) ** 2 for a, b, d in network.observations)


def adjusted(network: Network) -> NetworkSolution:
    """The network by the package."""
    names = [f"P{i}" for i in range(len(network.truth))]
    rows = [(names[a], names[b], d) for a, b, d in network.observations]
    d = network.truth.shape[1]
    return adjust_network(names, names[: network.fixed], rows, network.u, network.approximate, d)


def _flatness(x: np.ndarray) -> float:
    sizes = np.linalg.svd(x - x.mean(axis=0), compute_uv=False)
    return float(sizes[-1] / sizes[0])


def verdict(network: Network, seed: int) -> str:
    """ "right", or what is wrong."""
    best, place = scipy_best(network, seed)
    try:
        solution = adjusted(network)
    except Exception as error:  # whatever it is, it counts
        return f"refused: {error}"
    ours = chi_square(network, solution.coordinates)
    given_flat = _flatness(network.approximate) < 1e-12 and _flatness(solution.coordinates) < 1e-9
    if ours > best + (0.01 if given_flat else 1e-4):
        return f"chi-square {ours:.6g}, best {best:.6g}"
    if ours < best - 1e-4 or given_flat or not network.fixed:
        return "right"
    tolerance = np.maximum(0.01 * network.u, 1e-3 * np.nan_to_num(solution.standard_uncertainty))
    seconds = [(slice(None), solution.coordinates)]
    seconds += [
        ([solution.points.index(name) for name in one.points], one.coordinates) for one in solution.alternatives
    ]
    for rows, coordinates in seconds:
        x = solution.coordinates.copy()
        x[rows] = coordinates
        if not ((np.abs(x - place) > tolerance) & ~solution.not_determined).any():
            return "right"
    return f"same chi-square {ours:.6g}, coordinates {np.abs(solution.coordinates - place).max():.3g} apart"


def main() -> None:
    """Count and print, by kind."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.networks")
    parser.add_argument("--networks", type=int, default=1000)
    parser.add_argument("--first", type=int, default=0, help="seed of the first network")
    args = parser.parse_args()
    count: Counter[str] = Counter()
    right: Counter[str] = Counter()
    for seed in range(args.first, args.first + args.networks):
        network = KINDS[seed % len(KINDS)](np.random.default_rng(seed))
        said = verdict(network, seed)
        count[network.kind] += 1
        right[network.kind] += said == "right"
        if said != "right":
            print(f"seed {seed}, {network.kind}: {said}", flush=True)
    print("\n| networks | right | of |\n|---|---|---|")
    for kind in count:
        print(f"| {kind} | {right[kind]} | {count[kind]} |")
    print(f"| all | {sum(right.values())} | {sum(count.values())} |")


if __name__ == "__main__":
    main()
