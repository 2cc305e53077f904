"""Standard paths as plans: campaigns without readings, ready for `volid.simulate` and for writing as files.

`standard_plan` determines a machine with three linear axes from tracker distances; the others move rotary axes too.
"""

from volid.planning.ball_bar import cone_frustum
from volid.planning.ball_plate import ball_plate, plate_plan
from volid.planning.circles import circles
from volid.planning.diagonals import diagonals, parallel_lines, step_diagonals
from volid.planning.direct import direct_plan
from volid.planning.rtest import iso10791_path, rtest_static_grid
from volid.planning.step_gauge import step_gauge

__all__ = [
    "ball_plate",
    "circles",
    "cone_frustum",
    "diagonals",
    "direct_plan",
    "iso10791_path",
    "parallel_lines",
    "plate_plan",
    "rtest_static_grid",
    "step_diagonals",
    "step_gauge",
]
