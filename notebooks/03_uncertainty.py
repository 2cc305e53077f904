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
# # How sure? Budget, Monte Carlo and coverage of a campaign
#
# A tracker's distances are wrong together: all readings of a station share its refractive index, all readings with a tool share
# its length, and the whole campaign shares the machine's temperature. Such *systematic effects* do not average out. This notebook
# states them, lets the fit estimate what the data say of them, and asks how sure the results are: by propagation (GUM), as a
# budget, and by Monte Carlo refits (JCGM 101).
#
# **The data are synthetic**: the plan of `datasets/vertical_multilateration` on a virtual machine, with effects drawn at random.

# %%
from dataclasses import replace
from pathlib import Path

import numpy as np
from volid.plot import budget_bars, coverage_bands, volume_distribution

import volid
from volid.campaign import Effect
from volid.report.text.budget import format_budget
from volid.uncertainty.budget import budget, budget_lines, headline_rows
from volid.uncertainty.lack_of_fit import lack_of_fit
from volid.uncertainty.outputs import headline_outputs
from volid.uncertainty.statement import format_statement, statement
from volid.virtual.comparison import compare, covered

dataset = Path("../datasets/vertical_multilateration")
if not dataset.exists():  # run from the project's root
    dataset = Path("datasets/vertical_multilateration")

# %% [markdown]
# ## What is known beforehand
# In a manifest each of these is a `[[set.effect]]`. `u` is a standard uncertainty; `per` says which readings share one value.

# %%
effects = (
    Effect("refraction", "scale", 2e-7, "station", {"distribution": "rectangular"}),
    Effect("tool length", "tool_length", 1e-3, "tool", {"components": "XYZ"}),
    Effect("temperature", "temperature", 0.05, "campaign", {"expansion": 11e-6, "distribution": "triangular"}),
)
plan = volid.load_campaign(dataset / "campaign.toml")
plan = replace(plan, sets=(replace(plan.sets[0], effects=effects),))
campaign, truth = volid.simulate(plan, volid.random_truth(plan.machine, 3), seed=3)
for effect in effects:
    print(f"{effect.name}: {effect.type}, u = {effect.u:g}, one value per {effect.per}")

# %% [markdown]
# ## The fit
# Effects are unknowns with their `u` as prior knowledge, so the full covariance contains them.

# %%
solution = volid.fit(campaign)
tool = np.array([0.0, 0.0, -150.0])
print(solution.adequacy.verdict)
print("lack of fit:", lack_of_fit(solution))
for entry, value in zip(solution.nuisance_table, np.asarray(solution.nuisance), strict=True):
    if entry.effect and "tool" not in entry.effect:
        print(f"  {entry.name:24s} {value: .2e}   stated u {entry.prior_u:.1e}")

# %% [markdown]
# ## The budget
# Which source contributes how much to which output? The squares add up to u².

# %%
outputs = headline_outputs(solution, tool)
lines = list(budget_lines(budget(solution), headline_rows(solution, outputs)))
print(
    format_budget(
        [line for line in lines if line.output in ("EXX", "EAZ", "EC0Y", "EA0S", "V_X")], lack_of_fit(solution)
    )
)
budget_bars(lines)

# %% [markdown]
# ## Monte Carlo
# Every trial draws all readings and all effects anew, each from its own distribution, and fits again, exactly. Trial *i* of a
# seed is the same whatever the number of trials or workers.

# %%
solution = solution.monte_carlo(10_000, seed=1)
print(format_statement(statement(solution, tool, outputs)))

# %% [markdown]
# Bands of the functions that the effects touch most, about the estimate. The rectangular and triangular distributions hardly
# show: many readings share the work. Dashed, the truth, which a real campaign does not have.

# %%
coverage_bands(solution, ["EXX", "EYY", "EZZ", "EYX", "ECX", "EAZ"], truth.functions)

# %% [markdown]
# The largest deviation in the volume is no linear function of the parameters; its distribution need not lie about its estimate.

# %%
volume_distribution(solution, tool)

# %% [markdown]
# ## What if an effect is left out?
# The same readings, fitted as if noise were all. The residuals show that something is missing: the verdict says what it may be,
# and hold-outs of whole stations, times and places enlarge every u by one factor.

# %%
naive = volid.fit(replace(campaign, sets=(replace(campaign.sets[0], effects=()),)))
for name, found in (("effects stated", solution), ("effects left out", naive)):
    against = compare(found, truth)
    inside = np.concatenate([covered(against.functions[n], against.functions_u[n]) for n in against.functions])
    u = 1e6 * found.location("EC0Y").u
    print(
        f"{name:17s} u(EC0Y) = {u:.2f} µrad; 95 % intervals of functions that hold the truth: {np.nanmean(inside):.0%}"
    )
print(naive.adequacy.verdict)
print(*(cause.what for cause in naive.adequacy.causes), sep="\n")
