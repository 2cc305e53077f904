# ---
# jupyter:
#   jupytext:
#     formats: ipynb,py:percent
#     text_representation:
#       extension: .py
#       format_name: percent
#   kernelspec:
#     display_name: Python 3
#     language: python
#     name: python3
# ---

# %% [markdown]
# # From an R-test to the grid of the rotary axes
#
# A sphere stands on a tilting rotary table, three displacement sensors in the spindle watch it while both rotary axes
# take 37 × 13 positions and X, Y, Z follow. From three places of the sphere this notebook finds where the two axes of
# rotation lie, how they move while they turn, and ends with the spatial grid R-VOL that a control applies.
#
# **The data are synthetic.** They come from a separate exact chain of 4×4 matrices with error motions that are no splines
# (`datasets/five_axis_rtest/make.py`), so that the result can be compared with the truth.

# %%
import csv
from pathlib import Path

import numpy as np
from scipy.interpolate import CubicSpline
from volid.plot import angle_map, error_functions, location_errors, rotary_grid

import volid
from volid.compensation.grids.rotary import rotary_grids
from volid.fitting.location_errors import location_errors as table_of_location_errors
from volid.report.text.summary import summary

dataset = Path("../datasets/five_axis_rtest")
if not dataset.exists():  # run from the project's root
    dataset = Path("datasets/five_axis_rtest")

# %% [markdown]
# ## The machine and the campaign
# The table turns about C on a cradle that A tilts; a prime marks an axis that carries the workpiece. The linear axes are taken
# as perfect here: their functions are switched off in the machine file. With a campaign that measured them, `prior=` takes its
# solution instead.

# %%
campaign = volid.load_campaign(dataset / "campaign.toml")
machine = campaign.machine
print(machine.name, "|", machine.structure)
for axis in machine.axes:
    print(f"  {axis.letter}: {axis.travel[0]:g} … {axis.travel[1]:g} {axis.unit}")
for s in campaign.sets:
    names = ", ".join(dict.fromkeys(s.labels["sphere"].tolist()))
    print(f"set '{s.name}': {len(s)} readings of kind '{s.kind}', spheres {names}")

# %% [markdown]
# ## Identification
# The places of the spheres are unknown and found from the data, with two positions and two orientations and six error
# motions of each axis. The summary begins with the verdict; *held out* is the residual at a rotary position that is
# predicted from all other positions.

# %%
solution = volid.fit(campaign)
print(summary(solution))

# %% [markdown]
# ## Location errors
# Where the axes of rotation stand against where they should be, with bars of ± *U* (k = 2) that are hardly visible
# above and are seen below, where the truth is taken away.


# %%
def read(path):
    """Rows of a CSV file as dictionaries, comment lines left out."""
    return list(csv.DictReader(line for line in path.read_text().splitlines() if not line.startswith("#")))


table = read(dataset / "truth_functions.csv")
true_locations = {row["function"]: float(row["value"]) for row in table if not row["position"]}
location_errors(solution, true_locations)

# %% [markdown]
# These are axis average lines in the machine frame, as ISO 230-1 means EX0C and EA0C. The parameters of the model describe
# the tool relative to the workpiece: of an axis that carries the workpiece they have the other sign. C rides on A: in the
# machine frame its line has the errors of both.

# %%
print("error            line   parameter    U (k = 2)")
for row in table_of_location_errors(solution):
    scale, unit = (1e6, "µrad") if row.name[1] in "ABC" else (1e3, "µm")
    print(f"{row.symbol:8s} {scale * row.line:11.2f} {scale * row.parameter:11.2f} {2 * scale * row.u:8.2f} {unit}")

# %% [markdown]
# ## Error motions
# How each axis moves while it turns. Lines with bands of ± *U* (k = 2); dotted the truth.

# %%
truth = {}
for name in dict.fromkeys(row["function"] for row in table if row["position"]):
    rows = [row for row in table if row["function"] == name and row["position"]]
    x, y = np.array([(float(row["position"]), float(row["value"])) for row in rows]).T
    truth[name] = CubicSpline(x, y)
error_functions(solution, truth, axes="AC")

# %% [markdown]
# ## Does it predict where it has not measured?
# Every square is one pair of angles, left out of the fit. Noise of 0.5 µm in three directions has a length of 0.87 µm;
# a pattern here would mean that the model does not hold.

# %%
angle_map(solution)

# %% [markdown]
# ## The grid of the rotary axes
# Both axes stand under the workpiece, so one grid holds the rigid error of the table at every pair of positions, at a reference
# point. A control takes any other point from it by the lever arm (ISO/TR 16907, Table 3).

# %%
(grid,) = rotary_grids(solution)
print(f"{grid.type}, {grid.side}: {' × '.join(str(len(n)) for n in grid.nodes)} nodes over {', '.join(grid.axes)}")
print(f"largest u: {1e3 * grid.u[:, :3].max():.2f} µm, {1e6 * grid.u[:, 3:].max():.2f} µrad")
print(grid.lever_arm)
columns, rows = grid.table_3()
print("compensation values, mm and degrees; the first four nodes:")
print(" ".join(f"{c:>10s}" for c in columns))
for row in rows[:4]:
    print(f"{row[0]:10.0f} " + " ".join(f"{v:10.5f}" for v in row[1:]))

# %%
rotary_grid(grid, solution.machine.name)

# %% [markdown]
# ## Against the truth
# `truth_points.csv` holds the exact deviations at random positions of all five axes with random tool vectors. What
# would be left if a control applied the grid: the exact deviation less what the grid gives there.

# %%
rows = read(dataset / "truth_points.csv")
points = {key: np.array([float(row[key]) for row in rows]) for key in rows[0]}
q = machine.order(**{a: points[a] for a in "XYZAC"})
tools = np.stack([points["tool_x"], points["tool_y"], points["tool_z"]], axis=1)
exact = np.stack([points["ex"], points["ey"], points["ez"]], axis=1)
reached = np.stack([points["X"], points["Y"], points["Z"]], axis=1) + tools
angles = np.stack([points[a] for a in grid.axes], axis=1)


def size(field):
    """RMS and largest length of vectors in µm, as text."""
    length = 1e3 * np.linalg.norm(field, axis=1)
    return f"RMS {np.sqrt(np.mean(length**2)):6.2f} µm, largest {length.max():6.2f} µm"


print("deviation before       ", size(exact))
print("identified minus exact ", size(np.asarray(solution.deviation(q, tools))[:, :3] - exact))
print("left after the grid    ", size(exact - grid.at_points(angles, reached)[:, :3]))
