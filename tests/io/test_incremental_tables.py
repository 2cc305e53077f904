"""Incremental tables as they stand in a file: the running sum of the digits is never further off than half a step."""

import csv
import io
from decimal import Decimal

import numpy as np
import pytest
from support.control_cases import MACHINE, error_table

from volid.io.functions_csv import write_csv
from volid.io.tables import TableForm, table_lines, table_sheet

SMALL = {"EXX": 1e-9, "EAX": 1e-12}  # the last digit that is written [mm, rad]


def curves():
    rng = np.random.default_rng(21)
    for n in (2, 40, 1500):
        x = np.linspace(0.0, 1000.0, n)
        yield x, 0.02 * np.sin(x / 70.0) + rng.normal(scale=0.001, size=n)
        yield x, 0.0005 * np.arange(n)  # exactly between two steps of 1 µm
        yield x, -(np.arange(n) + 0.5) / 3.0 * 1e-4
        yield x, -0.00049 * np.arange(n)


def columns_of(function: str, x, values, form: TableForm) -> tuple[list[Decimal], list[Decimal]]:
    table = error_table(function, x, values, np.flip(values))
    stream = io.StringIO()
    write_csv(stream, table_sheet(table, form, table_lines(table, form, MACHINE)))
    rows = csv.DictReader(line for line in stream.getvalue().splitlines() if not line.startswith("#"))
    pairs = [(Decimal(r[f"{function}(+)"]), Decimal(r[f"{function}(-)"])) for r in rows]
    return [p[0] for p in pairs], [p[1] for p in pairs]


@pytest.mark.parametrize("function", ["EXX", "EAX"])
@pytest.mark.parametrize("least", [None, 0.001, 0.0001, 0.001 / 3.0])
def test_the_running_sum_of_the_written_digits(function, least):
    scale = 1.0 if function == "EXX" else 1e-3
    for x, values in curves():
        step = None if least is None else scale * least
        increment, angle = (step, None) if function == "EXX" else (None, step)
        form = TableForm(errors=True, incremental=True, increment=increment, angle_increment=angle)
        allowed = (
            0.5 * max(step or 0.0, SMALL[function]) + 0.5 * SMALL[function]
        )  # the step itself, as far as digits show it
        for exact, digits in zip(
            (scale * values, np.flip(scale * values)), columns_of(function, x, scale * values, form), strict=True
        ):
            total, off = Decimal(0), []
            for digit, value in zip(digits, exact.tolist(), strict=True):
                total += digit
                off.append(abs(float(total - Decimal(value))))
            assert max(off) <= allowed * (1 + 1e-6)
