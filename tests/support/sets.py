"""Whether two observation sets are the same to the last digit."""

from dataclasses import asdict, fields

import numpy as np

from volid.campaign import ObservationSet


def assert_same_set(a: ObservationSet, b: ObservationSet) -> None:
    for field in fields(ObservationSet):
        one, two = getattr(a, field.name), getattr(b, field.name)
        if isinstance(one, np.ndarray):
            np.testing.assert_array_equal(one, two)
            assert one.dtype == two.dtype
        elif field.name == "to":
            assert (one is None) == (two is None)
            for own, other in zip(one or (), two or (), strict=True):
                np.testing.assert_array_equal(own, other)
                assert own.dtype == other.dtype
        elif field.name == "labels":
            assert {k: v.tolist() for k, v in one.items()} == {k: v.tolist() for k, v in two.items()}
        elif field.name == "effects":
            assert [asdict(e) for e in one] == [asdict(e) for e in two]
        else:
            assert one == two, field.name
