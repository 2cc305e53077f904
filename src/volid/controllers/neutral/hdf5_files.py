"""Plain grids as HDF5, for programs that read them: volid's own files, every type of ISO/TR 16907 that has a grid."""

from __future__ import annotations

from volid.compensation.types import GRID
from volid.controllers.base import COMPENSATION, FREE, HELD, NO_REVERSAL, Declaration
from volid.controllers.neutral.own_files import COMMISSIONING, FACTS, OwnFiles, carried


class NeutralHdf5(OwnFiles):
    """One HDF5 file per grid."""

    hdf5 = True
    declaration = Declaration(
        name="hdf5",
        title="HDF5, grids of volid",
        carries={name: form for name, form in carried(GRID).items() if form == GRID},
        nearest="a type that is a table of an axis alone has no grid; csv carries it",
        sign=COMPENSATION,
        units="mm and degrees of position; mm and degrees",
        reversal=NO_REVERSAL,
        outside=HELD,
        spacing=FREE,
        limits="as many as there are",
        model=True,
        zero="wherever the datum puts it; each file says where",
        switching="one file per grid: leave one out, and it is off",
        commissioning=COMMISSIONING,
        facts=FACTS,
    )


NEUTRAL_HDF5 = NeutralHdf5()
