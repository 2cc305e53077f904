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
# # From a tracker campaign to a compensation grid
#
# A vertical machining centre was measured with a tracking interferometer from six stations, with three tool vectors. This
# notebook turns the 2 400 distances into the machine's 21 error functions with their uncertainties, asks the data whether
# the model is right, and ends with a spatial grid that a control can load.
#
# **The data are synthetic.** They come from a separate exact chain of 4×4 matrices with error functions that are no splines
# (`datasets/vertical_multilateration/make.py`), so that the result can be compared with the truth.

# %%
import csv
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
from scipy.interpolate import CubicSpline
from volid.plot import error_functions, residual_plot, volume_sections

import volid
from volid.compensation.grids.linear import linear_grid
from volid.compensation.residual.volume import predict_residual, volumetric_summary
from volid.report.text.summary import summary

dataset = Path("../datasets/vertical_multilateration")
if not dataset.exists():  # run from the project's root
    dataset = Path("datasets/vertical_multilateration")

# %% [markdown]
# ## The machine and the campaign
# The structural code runs from the workpiece to the tool; a prime marks an axis that carries the workpiece.

# %%
campaign = volid.load_campaign(dataset / "campaign.toml")
machine = campaign.machine
print(machine.name, "|", machine.structure)
for axis in machine.axes:
    side = "workpiece side" if axis.primed else "tool side"
    print(f"  {axis.letter}: {axis.travel[0]:g} … {axis.travel[1]:g} mm, {side}")
for s in campaign.sets:
    print(f"set '{s.name}': {len(s)} readings of kind '{s.kind}' from {len(set(s.labels['station']))} stations")

# %% [markdown]
# ## Identification
# Stations and dead paths are unknown and found from the data. How smooth each function is follows from the
# readings too, and what that leaves open between the positions is part of every uncertainty.

# %%
solution = volid.fit(campaign)
tool = (0.0, 0.0, -150.0)
print(summary(solution, tool))

# %% [markdown]
# ## Are the residuals noise?
# Normalised by their own standard uncertainty they should be standard normal, in every region and for every station.

# %%
residual_plot(solution)

# %% [markdown]
# ## The error functions
# Lines with bands of ± *U* (k = 2); dotted the truth, which a real campaign does not have.


# %%
def read(path):
    """Rows of a CSV file as dictionaries, comment lines left out."""
    return list(csv.DictReader(line for line in path.read_text().splitlines() if not line.startswith("#")))


table = [row for row in read(dataset / "truth_functions.csv") if row["position"]]
truth = {}
for name in dict.fromkeys(row["function"] for row in table):
    x, y = np.array([(float(row["position"]), float(row["value"])) for row in table if row["function"] == name]).T
    truth[name] = CubicSpline(x, y)
error_functions(solution, truth)

# %% [markdown]
# ## Where in the volume, and how much

# %%
volume_sections(solution, tool)

# %% [markdown]
# ## The compensation grid, and what it will leave
# The control interpolates linearly between the nodes; the prediction combines that with the uncertainty of the solution.

# %%
grid = linear_grid(solution, points=21, tool=tool)
before = volumetric_summary(solution, tool)
after = predict_residual(solution, grid)
print(f"{len(grid.positions)} nodes; largest u of a translation {1e3 * grid.u[:, :3].max():.2f} µm")
print(f"largest deviation before: {1e3 * before.before_max:.1f} µm")
low, high = after.interval
print(f"predicted largest deviation after: {1e3 * after.maximum:.2f} µm (95 %: {1e3 * low:.2f} to {1e3 * high:.2f} µm)")

# %% [markdown]
# ## Against the truth
# `truth_points.csv` holds the exact deviations at random positions. With unknown stations a field is defined up to a rigid
# motion of the workpiece frame, so that is removed from the difference.

# %%
rows = read(dataset / "truth_points.csv")
points = {key: np.array([float(row[key]) for row in rows]) for key in rows[0]}
q = machine.order(X=points["X"], Y=points["Y"], Z=points["Z"])
tools = np.stack([points["tool_x"], points["tool_y"], points["tool_z"]], axis=1)
exact = np.stack([points["ex"], points["ey"], points["ez"]], axis=1)
difference = np.asarray(solution.deviation(q, tools))[:, :3] - exact
target = np.stack([points["X"], points["Y"], points["Z"]], axis=1) + tools
rigid = np.zeros((len(target), 3, 6))
rigid[:, :, :3] = np.eye(3)
for k in range(3):
    rigid[:, :, 3 + k] = np.cross(np.eye(3)[k], target - target.mean(axis=0)) / 1000.0
basis, _ = np.linalg.qr(rigid.reshape(-1, 6))
left = (difference.ravel() - basis @ (basis.T @ difference.ravel())).reshape(-1, 3)
size = np.linalg.norm(left, axis=1)
print(f"identified minus exact, 3-D: RMS {1e3 * np.sqrt(np.mean(size**2)):.2f} µm, largest {1e3 * size.max():.2f} µm")

# %% [markdown]
# ## Differentiate it
# A solution is a JAX pytree, the deviation a pure function of position and tool.

# %%
slope = jax.jacfwd(lambda position: solution.deviation(position, jnp.array(tool))[:3])(
    jnp.array([300.0, 500.0, -250.0])
)
print("∂(ex, ey, ez)/∂(axis positions) in µm/m, columns", ", ".join(machine.letters))
print(np.round(1e6 * np.asarray(slope), 1))
