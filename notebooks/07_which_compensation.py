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
# # Which compensation type buys what?
#
# ISO/TR 16907 knows fifteen types of compensation. A control has some of them, each costs something: a measurement, an option
# of the control, a table to keep. This notebook asks, for one machine, what each of them leaves, before anything is loaded; how
# far that depends on the tool, on the fineness of a grid and on the resolution of the control; and what rotary axes add.
#
# **The data are synthetic.** Because the machine is virtual, the prediction can be compared with what truly remains.

# %%
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import volid

root = Path("..") if Path("../datasets").exists() else Path(".")
TOOL, LONG, SIDEWAYS = (0.0, 0.0, -150.0), (0.0, 0.0, -350.0), (80.0, 0.0, -250.0)

# %% [markdown]
# ## A machine
# The plan of the bundled tracker campaign on a virtual machine whose errors are drawn at random: 2400 distances, six stations,
# three tool vectors.

# %%
plan = volid.load_campaign(root / "datasets/vertical_multilateration/campaign.toml")
truth = volid.random_truth(plan.machine, 4)
campaign, truth = volid.simulate(plan, truth, seed=4)
solution = volid.fit(campaign)
print(solution.adequacy.verdict)
assert not solution.adequacy.rejected

# %% [markdown]
# ## Type by type
# `volid.forecast` (on the command line `volid residual`) lets a simulated control apply each type as it would be written, and
# evaluates what remains over the whole working volume, with 95 % intervals from the covariance of the solution. A rigid motion
# of the workpiece is taken out: aligning the part takes it up. Tables hold along the specific lines through the middle of the
# travels, and for one tool.

# %%
TYPES = [["L-POS"], ["L-STR"], ["L-SQU"], ["L-POS", "L-SQU"], ["L-POS", "L-STR", "L-SQU"], ["L-VOL"]]
base = volid.compensation_base(solution, TOOL)
found = volid.forecast(solution, TYPES, base)


def table(forecast):
    """Largest and RMS deviation with its interval [µm], largest tilt of the tool axis [µrad]."""
    print(f"{'type':24}{'largest':>9}{'[95 %]':>18}{'RMS':>8}{'tool axis':>11}")
    for column in forecast.columns:
        p = column.predictions[0]
        interval = f"{1e3 * p.low[0]:.1f} … {1e3 * p.high[0]:.1f}"
        print(f"{column.name:24}{1e3 * p.value[0]:9.1f}{interval:>18}{1e3 * p.value[2]:8.1f}{1e6 * p.value[-1]:11.0f}")


table(found)

# %%
volid.plot.forecast_figure(found, plan.machine.name)

# %% [markdown]
# Positioning tables, which every control has, take away a part, and squareness alone nothing at all here: one error may have
# hidden another. All tables together leave what the *rotations* of the axes do beside the specific lines: every 10 µrad is 5 µm
# at half a metre. Only L-VOL knows these lever arms. **No type without rotary axes corrects the orientation of the tool**: the
# last column changes only because another rigid motion of the workpiece is taken out.

# %% [markdown]
# ## Is the forecast right?
# The virtual machine can be asked. The control moves to the compensated commands, the true machine adds its true errors there,
# and a rigid motion is taken out. The forecast had only the readings.

# %%
rng = np.random.default_rng(0)
order = ["XYZ".index(a) for a in plan.machine.letters]
places = np.stack([rng.uniform(*plan.machine.axis(a).travel, 2000) for a in "XYZ"], axis=-1)


def truly_remains(types, tool=TOOL, points=21):
    """RMS of what truly remains at the places, rigid motion taken out [mm]."""
    q = places[:, order]
    made = volid.compensate(solution, types, base, points=points, uncertainty=False)
    moved = volid.Control(plan.machine, tables=made.tables, grids=made.grids).command(q, np.array(tool))
    back = np.argsort(order)
    e = (moved - q)[:, back] + truth.deviation(moved, np.array(tool))[:, :3]
    middle = places - places.mean(axis=0)
    turned = [np.cross(unit, middle) for unit in np.eye(3)]
    shifted = [np.broadcast_to(unit, e.shape) for unit in np.eye(3)]
    design = np.stack([*turned, *shifted], axis=-1).reshape(-1, 6)
    left = e.ravel() - design @ np.linalg.lstsq(design, e.ravel(), rcond=None)[0]
    return np.sqrt(3.0 * np.mean(left**2))


print(f"{'type':24}{'forecast RMS [95 %]':>24}{'truly':>8}   µm")
for column, types in zip(found.columns[1:], TYPES, strict=True):
    p = column.predictions[0]
    true = truly_remains(types)
    interval = f"{1e3 * p.value[2]:.2f} [{1e3 * p.low[2]:.2f} … {1e3 * p.high[2]:.2f}]"
    print(f"{column.name:24}{interval:>24}{1e3 * true:8.2f}")
    assert 0.9 * p.low[2] < true < 1.1 * p.high[2]  # other places, 2000 of them, than those of the forecast

# %% [markdown]
# ## Another tool
# Tables are made for one tool vector. A grid holds rotations too, so that a control which knows its tool gets every other one.
# What if the tool is longer than the one the tables were made for, or stands out sideways, or if the control has a wrong
# length, here 50 mm too short?

# %%
ALL = [["L-POS", "L-STR", "L-SQU"], ["L-VOL"]]
rows = [("as made for", TOOL, (0, 0, 0)), ("longer", LONG, (0, 0, 0)), ("sideways", SIDEWAYS, (0, 0, 0))]
rows.append(("length wrong in the control", TOOL, (0.0, 0.0, 50.0)))
print(f"{'largest that remains, µm':30}{'none':>8}{'tables':>8}{'L-VOL':>8}")
for name, tool, wrong in rows:
    asked = volid.forecast(solution, ALL, base, np.array([tool]), tool_error=wrong)
    print(f"{name:30}" + "".join(f"{1e3 * c.predictions[0].value[0]:8.1f}" for c in asked.columns))

# %% [markdown]
# L-VOL stays as good with every tool, as long as the control has the right length. A wrong one makes an error of its own: the
# angle times the missing length.

# %% [markdown]
# ## How fine a grid?
# A grid is interpolated linearly. What interpolation leaves falls with the square of the spacing, until it drowns in the
# uncertainty of the measurement; finer grids then cost memory and buy nothing.

# %%
POINTS = (5, 9, 21, 41)
remaining = [volid.forecast(solution, [["L-VOL"]], base, points=n).columns[1].predictions[0] for n in POINTS]
rms, exact = (1e3 * np.array([getattr(p, which)[2] for p in remaining]) for which in ("value", "exact"))
fig, panel = plt.subplots(figsize=(7, 4))
panel.loglog(POINTS, rms, "o-", color="#0072B2", label="expected, uncertainty of the measurement included")
panel.loglog(POINTS, exact, "s--", color="#D55E00", label="interpolation alone")
panel.loglog(POINTS, exact[0] * (4 / (np.array(POINTS) - 1)) ** 2, ":", color="#6B6B6B", label="square of the spacing")
panel.set(
    xlabel="nodes per axis", ylabel="RMS that remains / µm", title="L-VOL, tool (0, 0, -150) mm; 5 to 41 nodes per axis"
)
panel.set_xticks(POINTS, [str(n) for n in POINTS])
panel.minorticks_off()
panel.yaxis.set_major_formatter("{x:g}")
panel.legend(frameon=False)
fig.tight_layout()
assert exact[-1] < 0.05 * exact[0]

# %% [markdown]
# ## How fine a control?
# Compensation values are rounded to the least increment of the axes.

# %%
for increment in (0.001, 0.005, 0.010):
    rounded = volid.forecast(
        solution, [["L-VOL"]], base, control={"increment": dict.fromkeys("XYZ", increment)}
    ).columns[1]
    p = rounded.predictions[0]
    print(f"increment {1e3 * increment:4.1f} µm: largest {1e3 * p.value[0]:5.2f} µm, RMS {1e3 * p.value[2]:.2f} µm")

# %% [markdown]
# ## What rotary axes need
# A tilting rotary table, measured by R-test; the linear axes are taken as compensated. R-POS corrects the angle alone, R-POR
# the place and tilt of the axis lines, R-RAX radial and axial motions at one elevation, R-VOL all of it for every place on the
# table. L-VOL, made for the linear axes, does nothing here.

# %%
rotary = volid.fit(volid.load_campaign(root / "datasets/five_axis_rtest/campaign.toml"))
print(rotary.adequacy.verdict)
rotary_base = volid.compensation_base(rotary, TOOL)
ROTARY = [["R-POS"], ["R-POR"], ["R-RAX"], ["R-VOL"], ["R-VOL+"]]
turning = volid.forecast(rotary, ROTARY, rotary_base, points=19)
table(turning)

# %% [markdown]
# Most of the error of a rotary table is usually where its axes *are* (R-POR), which four numbers for each axis correct: the
# cheapest compensation there is. R-VOL takes the rest. R-VOL+ also turns the rotary axes to correct the orientation, as far as
# they can: the component that no rotary axis turns stays.

# %% [markdown]
# ## Which one, then?
# - A control with tables only: L-POS, L-STR and L-SQU, made **where parts are clamped** (`at=`) and for the usual tool.
# - Parts all over the table, or several tools: L-VOL. The measurement is the same.
# - A grid as fine as the figure above says, not finer.
# - Rotary axes: first R-POR, after the linear axes are corrected.
# - Orientation matters (long tools, five-axis flank milling): only R-VOL+, L-VOL+ or FOR change it.
