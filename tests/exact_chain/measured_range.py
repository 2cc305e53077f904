"""What a truth of three linear axes says in the datum of a measured part of the travels."""

from collections.abc import Callable, Mapping

import numpy as np

from exact_chain.truth import Truth


def truth_of_range(
    truth: Truth, ranges: Mapping[str, tuple[float, float]], reference: Mapping[str, float]
) -> tuple[dict[str, Callable], dict[str, float]]:
    """Functions and squareness over measured ranges that hold the references; primary axis X, secondary axis Y.

    The reference lines of straightness are those of the range. With s the slope of what the truth has there, functions lose it,
    and EC0Y' = EC0Y - s(EXY) - s(EYX), EA0Z' = EA0Z - s(EYZ) - s(EZY), EB0Z' = EB0Z + s(EXZ) + s(EZX).
    """
    node, weight = np.polynomial.legendre.leggauss(200)
    slope, functions = {}, {}
    for name, function in truth.functions.items():
        low, high = ranges[name[2]]
        x = 0.5 * (low + high) + 0.5 * (high - low) * node
        arm = x - 0.5 * (low + high)
        straightness = name[1] in "XYZ" and name[1] != name[2]
        slope[name] = float(weight @ (arm * function(x)) / (weight @ arm**2)) if straightness else 0.0
        at = reference[name[2]]
        functions[name] = lambda q, f=function, s=slope[name], at=at: f(q) - f(at) - s * (q - at)
    c = truth.constants
    squareness = {
        "EC0Y": c["EC0Y"] - slope["EXY"] - slope["EYX"],
        "EA0Z": c["EA0Z"] - slope["EYZ"] - slope["EZY"],
        "EB0Z": c["EB0Z"] + slope["EXZ"] + slope["EZX"],
    }
    return functions, squareness
