"""Standard paths as plans: campaigns without readings, ready for `volid.simulate` and for writing as files.

`standard_plan` determines a machine with three linear axes from tracker distances; the others move rotary axes too.
"""

from volid.planning.ball_bar import cone_frustum
from volid.planning.circles import circles
from volid.planning.direct import direct_plan
from volid.planning.rtest import iso10791_path, rtest_static_grid
from volid.planning.step_gauge import step_gauge

__all__ = ["circles", "cone_frustum", "direct_plan", "iso10791_path", "rtest_static_grid", "step_gauge"]
