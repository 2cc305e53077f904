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
# # Mixed evidence: a ball bar, four diagonals and one station
#
# Few workshops own a tracking interferometer and three days. Many own a ball bar and can borrow a laser. Each of them
# alone leaves most of the error model open. This notebook puts three of them into one fit: a ball bar on circles in three planes
# (ISO 230-4), displacements along the four body diagonals (ISO 230-6), and distances from a single station of a tracking
# interferometer. It asks of each what it determines, alone and together, and which number comes from whom.
#
# **The data are synthetic**: the plans of `volid plan` on a virtual machine with random errors, noise and instruments drawn. Its
# error functions are quartic polynomials, and the model knows it (`degree = 4`, `segments = 1`): 18 functions of four
# coefficients, of which three are rotations of the frame, and three constants of the tool. Counts of what is determined then
# compare with published ones.

# %%
from dataclasses import replace
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import volid
from volid.campaign import Campaign
from volid.model.machine import Axis
from volid.planning import circles, diagonals
from volid.planning.standard import standard_plan
from volid.report.text.sets import set_test_lines
from volid.report.text.summary import summary_data
from volid.virtual.comparison import compare, covered
from volid.virtual.truth import Truth

models = Path("../models") if Path("../models").exists() else Path("models")
vertical = volid.load_machine(models / "wYXbZt_vertical.toml")
machine = replace(vertical, model=replace(vertical.model, degree=4, segments=1))
TOOLS = ((0.0, 0.0, -150.0), (80.0, 0.0, -250.0), (0.0, 90.0, -200.0))

# %% [markdown]
# ## Three plans
# The ball bar runs circles of 150 mm around the middle of the table with its calibrated length. The laser reads along the body
# diagonals with a retro-reflector in the spindle. The tracking interferometer stands at one place beside the table, and sees
# three tool vectors; its place and its dead paths are unknown.

# %%
bar = circles(machine, length=150.0, n=37, u=0.0005, calibrated_u=0.0005)
laser = diagonals(machine, n=21, faces=False, u=0.0005)
tracker = standard_plan(machine, n_per_station=300, seed=1, tools=TOOLS)
first = tracker.sets[0].labels["station"] == "S1"
one_station = replace(
    tracker,
    stations=tracker.stations[:1],
    sets=(replace(tracker.sets[0].rows_of(np.flatnonzero(first)), name="station"),),
)


def joined(*plans: Campaign) -> Campaign:
    """One campaign of several plans for one machine."""
    return Campaign(
        machine,
        tuple(s for p in plans for s in p.stations),
        tuple(s for p in plans for s in p.sets),
        "Mixed evidence (synthetic)",
    )


rng = np.random.default_rng(5)


def quartic(axis: Axis, size: float) -> np.polynomial.Polynomial:
    """A random polynomial of the fourth degree over an axis, 0 in the middle."""
    coefficients = [0.0, *(size * rng.normal(size=4))]
    return np.polynomial.Polynomial(coefficients, domain=axis.travel)


SIZE = {"translation": 3e-3, "rotation": 8e-6}  # mm, rad
functions = {
    f"{kind}{c}{axis.letter}": quartic(axis, SIZE["translation" if c in "XYZ" else "rotation"])
    for axis in machine.axes
    for kind, c in (("E", c) for c in "XYZABC")
}
truth = Truth(machine, functions, constants={"EC0Y": 20e-6, "EA0Z": -15e-6, "EB0Z": 10e-6})
campaign, _ = volid.simulate(joined(bar, laser, one_station), truth, seed=5)
for s in campaign.sets:
    print(f"{s.name:16} {s.kind:11} {len(s):4} readings")

# %% [markdown]
# ## One fit
# The verdict is on all readings together, and on every set by itself: whether its residuals are as large as its u says, and
# whether it contradicts what the others predict for it.

# %%
solution = volid.fit(campaign)
print(solution.adequacy.verdict)
for line in set_test_lines(summary_data(solution)):
    print(line)

# %% [markdown]
# ## Who determines what
# Counted in combinations of the parameters of the error model. *By itself*: what the set would determine alone. *Only it*: what
# would be lost without it.

# %%
found = volid.who_determines(solution)
print(f"{'set':16} {'by itself':>10} {'only it':>8}   of {found.sets[0].parameters}")
for row in found.sets:
    print(f"{row.set:16} {row.by_itself:10d} {row.only:8d}")
print(f"{'together':16} {found.sets[0].together:10d}")
assert all(row.by_itself < row.together for row in found.sets)

# %% [markdown]
# For every function the largest standard uncertainty over its measured range: from each set alone, and from all together.
# "n.d.": not determined. Squareness is seen by the ball bar as well as by the diagonals, and is better known from both.

# %%
names = [s.name for s in campaign.sets]
FACTOR = {"mm": 1e3, "rad": 1e6}  # to µm and µrad
print(f"{'function':9}" + "".join(f"{n:>16}" for n in names) + f"{'together':>12}")


def shown(value: float, unit: str) -> str:
    """A standard uncertainty in µm or µrad."""
    return "n.d." if np.isnan(value) else f"{value * FACTOR[unit]:.3g}"


for name in solution.model.names:
    shares = [found.share(name, n) for n in names]
    alone = "".join(f"{shown(s.u_alone, s.unit):>16}" for s in shares)
    print(f"{name:9}{alone}{shown(shares[0].u, shares[0].unit):>12}")

# %% [markdown]
# ## Smaller uncertainty together
# Each bar is the u of a function without one of the sets, over the u with all: 1 means that the others know it as well. An arrow
# means that without the set the function would not be determined at all.

# %%
functions_known = [n for n in solution.model.names if np.isfinite(found.share(n, names[0]).u)]
fig, panels = plt.subplots(1, len(names), figsize=(12, 4.5), sharey=True)
for panel, name in zip(panels, names, strict=True):
    ratio = np.array([found.share(f, name).u_without / found.share(f, name).u for f in functions_known])
    lost = np.isnan(ratio)
    panel.barh(functions_known, np.where(lost, 5.0, np.fmin(ratio, 5.0)), color=np.where(lost, "#D55E00", "#0072B2"))
    panel.plot(np.full(lost.sum(), 5.0), np.flatnonzero(lost), ">", color="#D55E00")
    panel.axvline(1.0, color="black", lw=0.8)
    panel.set(title=f"without {name}", xlabel="u without it / u with all", xlim=(0.0, 5.4))
panels[0].invert_yaxis()  # shared by all
fig.tight_layout()

# %% [markdown]
# ## What is missing, and what settles it
# Four combinations remain open, all of the axis that carries the table. The solution says of which functions, and why.

# %%
for statement in solution.statements:
    print(statement)

# %% [markdown]
# The ball bar is cheap to move: two more places of its socket, with the other two tool vectors, close the gap.


# %%
def bar_at(name: str, centre: tuple[float, float, float], tool: tuple[float, float, float]) -> Campaign:
    """The ball bar with its socket at another place, and another tool vector."""
    plan = circles(machine, tool=tool, centre=centre, length=150.0, n=37, u=0.0005, calibrated_u=0.0005)
    sets = (
        replace(s, name=f"{s.name} {name}", labels={**s.labels, "station": np.full(len(s), name)}) for s in plan.sets
    )
    return replace(plan, stations=(replace(plan.stations[0], name=name),), sets=tuple(sets))


more = (bar_at("near", (250.0, 200.0, -450.0), TOOLS[1]), bar_at("far", (750.0, 400.0, -450.0), TOOLS[2]))
complete, true = volid.simulate(joined(bar, laser, one_station, *more), truth, seed=5)
whole = volid.fit(complete)
print(whole.adequacy.verdict)
print(f"{whole.model.n_parameters - whole.null_space.shape[1]} of {whole.model.n_parameters} combinations determined")
assert whole.fully_determined

# %% [markdown]
# ## Is it right?
# The truth of the virtual machine is known. The difference between the solution and the truth is compared with its own u, at
# places over the measured volume with the tool vectors that were used, and for every function at positions of its axis.

# %%
result = compare(whole, true)
worst = np.max(np.abs(result.field) / result.field_u)
print(f"field: difference RMS {1e3 * np.sqrt(np.mean(result.field**2)):.2f} µm, ", end="")
print(f"u RMS {1e3 * np.sqrt(np.mean(result.field_u**2)):.2f} µm, largest difference {worst:.1f} u")
inside = {n: float(np.nanmean(covered(result.functions[n], result.functions_u[n]))) for n in whole.model.names}
print(f"functions inside their 95 % intervals: {100 * np.nanmean(list(inside.values())):.0f} % of all positions")
for name in ("EC0Y", "EA0Z", "EB0Z"):
    row = whole.location(name)
    difference = 1e6 * float(result.functions[name][0])
    print(
        f"{name}: {1e6 * row.value:.1f} ± {2e6 * row.u:.1f} µm/m (k = 2), off the truth in this datum by {difference:.1f}"
    )

# %% [markdown]
# ## What if an instrument's u is wrong?
# The ball bar's readings get a u that is five times too small. The factors of all sets are then estimated from the residuals by
# restricted maximum likelihood; the stated u stays in the file.

# %%
wrong = replace(
    campaign,
    sets=tuple(replace(s, u=s.u / 5.0) if s.name in ("circle XY", "arc YZ", "arc ZX") else s for s in campaign.sets),
)
print(volid.fit(wrong).adequacy.verdict)
estimated = volid.fit(wrong, estimate_u=True)
print(estimated.adequacy.verdict)
for c in estimated.variance_components:
    print(f"{c.set:11} u · {c.factor:.2f} ± {c.u:.2f} ({c.redundancy:.0f} degrees of freedom)")
