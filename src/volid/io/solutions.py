"""Solutions in one self-contained HDF5 file, `volid-solution/1`, readable with plain h5py.

n: free parameters θ of the error model; c: spline coefficients and constants; k: nuisance parameters ν (stations, dead
paths, …); m: rows of a set, r: readings per row. Lengths [mm], rotations [rad], positions [mm or degrees].
Root attributes: `format`; `machine_name`; `axes` (letters, machine axis order); `options` (JSON text).
- `machine`: text of the machine file, scalar. `campaign/`: the complete campaign, laid out as a `volid-campaign/1` file.
- `datum/`: attributes `primary`, `secondary`, `line`; `reference` (JSON text: axis -> position that overrides its own).
- `functions/<ISO 230-1 symbol>/`, for those who only want to read: attributes `description`, `axis`, `unit`, `segments`;
  `position` (p,) (NaN for a constant), `direction` (p,), `value` and `u` (p,), NaN where the data do not determine it. A location
  error is that of the axis average line in the machine frame, as its attribute `refers_to` says; a function of two axes stands at
  the other's reference. An error motion also has `coefficients`, one dimension per entry of its attributes `spline_axes`,
  `spline_low`, `spline_high`, `spline_segments`, `spline_degree`, `spline_periodic`:
  f(q) = Σ c_i B_i(q) with uniform knots low + (high - low)/segments · (i - degree); when periodic, q is taken into
  [low, high) and c_i goes on with c_(i - segments).
  `reversal_coefficients` likewise: B = E(+) - E(-); a single number when B is constant.
- `parameters/`: `label`, `function` (several, joined by +, when their datum rules couple them), `part`, `unit`, `value`, `u`,
  each (n,): coordinates of the coefficients in a basis that keeps to the datum; constants as parameters, tool relative to
  workpiece. `model/`: attributes `segments` and `carrier`
  (JSON texts: symbol -> intervals within the measured range, and in which coefficients are stored) and `ranges` (JSON text: axis
  letter -> measured range, which functions and datum refer to), `parametrisation` P (c, n) and `coefficients` P θ (c,).
- `nuisance/`: `name`, `unit`, `value`, `u`, each (k,), and what the fit began with: `start`, `prior_u` (inf: unknown, 0:
  exact), `spread`; `distribution`, `effect`; `key` (JSON list: what it is) and `response` (JSON object: how it answers a rigid
  motion of the frame it lives in, see `volid.observations.response`).
- `covariance` (n + k, n + k): of (θ, ν), in the units of both; zero along what is not determined.
- `prior_root` (r, n), only after a fit with an earlier solution: its pseudo-readings W θ with unit variance.
- `smoothness/`, where the smoothness of functions was estimated: `name` of its parameters, such as "EXX size" and "EXX length",
  `value` and `u` of their logarithms [of mm or rad; of the range]; `root` W (r, n), pseudo-readings W θ = 0 with unit variance;
  `noise` G (r, h), their covariance is 1 + G Gᵀ because the parameters are uncertain; `spread` (n + k, h), what G brings to the
  unknowns: `covariance` is `factor`² times the sum of the inverse of JᵀJ and `spread` times its transpose; attribute `scatter`
  (JSON text: direction -> standard deviation of what is independent from position to position [mm], part of every u of a
  deviation).
- `identifiability/`: `statements` (text, what is not determined); `null_space` (n, d), combinations of θ that are not determined;
  `held_directions` (s, h), directions of the s tool-frame constants held at 0; `undetermined/function`, `/directions`.
- `residuals/1`, `/2`, …, in the order of `campaign/sets`: attributes `set`, `rms`; `residual` (m, r) = reading - predicted,
  `normalised` (m, r) = residual/(u sqrt(1 - h)), `outlier` (m, r), set aside by the robust fit; on machines with rotary
  axes `held_out` (m, r) = reading - prediction by the fit to all other rotary positions, NaN where one position alone determines
  a combination of the parameters.
- `adequacy/`: attributes `verdict`, `grade` ("accepted", "accepted, u enlarged", "questioned", "rejected",
  "not testable"), `rejected`,
  `factor` (what every u is multiplied by; `covariance` holds its square), `chi_square`, `degrees_of_freedom`, `unit_weight`,
  `probability`; `causes/`: `cause`, `what`, `cure`, `drop` (of chi-square), `gain`, `unknowns`, `log10_probability`, `change` (of
  the result, over U), each (c,), the most likely first; `questions/`: `text`, `about_values` (no table before
  it is answered), each (q,); `groups/`: `what`, `n`, `unit_weight`, `probability`, `sort`, each (g,),
  least probable first; `sets/`: what is found of each set among the others, one dataset per field of
  `volid.fitting.mixed.records.SetTest`, each (s,); `suspects/`: `where`, `label`, `residual`, `normalised`, `unit`, each (s,).
  `outliers/`: the same columns, for the readings that were set aside.
- `variance_components/`, where u was estimated: `set`, `part`, `n`, `redundancy`, `factor`, `u` (of the factor; NaN where the u
  was kept), `state`, each (c,); `stated_u/1`, `/2`, … (m, r), in the order of `campaign/sets`, whose `u` hold the factors.
- `statistics/`: attributes `n_readings`, `n_parameters`, `iterations`, `converged`. `notes`: text, (t,).
- `monte_carlo/`, once run: attributes `trials` M, `seed`, `tolerance` (numerical tolerance reached over the one wanted, NaN for a
  fixed M); `samples` (M, n + k) of (θ, ν); `chi_square`, `error` (distance to the minimum in standard uncertainties), `solved`
  (by the full solver), `outliers` (set aside in the trial), each (M,).
- `provenance/`: attributes: date, versions, command, SHA-256 of the inputs.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from volid.exceptions import OutputError
from volid.fitting.change_of_datum import EXTRAPOLATED
from volid.fitting.diagnosis.adequacy import SuspectReading
from volid.fitting.solution import Solution
from volid.io.basics.hdf5_values import reading, to_json, write_array, write_text
from volid.io.basics.hdf5_writing import hdf5_output
from volid.io.campaign.hdf5 import read_campaign_group, write_campaign_group
from volid.io.nuisance import read_nuisance
from volid.io.solution_reading import (
    FORMAT,
    read_adequacy,
    read_model,
    read_numbers,
    read_prior,
    read_residuals,
    read_samples,
    read_smoothness,
    read_statistics,
    read_undetermined,
    read_variance_components,
)
from volid.io.solution_writing import (
    write_adequacy,
    write_datum,
    write_functions,
    write_identifiability,
    write_parameters,
    write_residuals,
    write_rows,
    write_samples,
    write_smoothness,
    write_variance_components,
)


def write_solution(solution: Solution, path: str | Path, overwrite: bool = False) -> None:
    """Write a solution to one HDF5 file that holds everything, its campaign and machine included.

    Args:
        solution: A solution, as `volid.fit` makes it.
        path: Path of the file, ending in .h5.
        overwrite: replace an existing file.

    Raises:
        OutputError: `path` exists, or cannot be written, or the solution is an extrapolated one; then nothing is written.

    >>> import volid
    >>> from pathlib import Path
    >>> from tempfile import mkdtemp
    >>> path = Path(mkdtemp()) / "solution.h5"
    >>> solution = volid.fit(volid.load_campaign("datasets/published_positioning/campaign.toml"))
    >>> volid.save_solution(solution, path)
    >>> bool((volid.load_solution(path).parameters == solution.parameters).all())
    True
    """
    if EXTRAPOLATED in solution.options:
        raise OutputError(f"{path}: an extrapolated solution is not saved; save the solution that it was made from")
    with hdf5_output(path, overwrite) as file:
        file.attrs["format"] = FORMAT
        file.attrs["machine_name"] = solution.machine.name
        file.attrs["axes"] = list(solution.machine.letters)
        file.attrs["options"] = to_json(solution.options)
        write_campaign_group(solution.campaign, file.create_group("campaign"))
        file["machine"] = file["campaign/machine"]
        write_datum(file.create_group("datum"), solution.datum)
        write_functions(file.create_group("functions"), solution)
        write_parameters(file, solution)
        if solution.prior_root is not None:
            write_array(file, "prior_root", solution.prior_root)
        if solution.smooth is not None:
            write_smoothness(file.create_group("smoothness"), solution.smooth)
        write_identifiability(file.create_group("identifiability"), solution)
        write_residuals(file.create_group("residuals"), solution)
        write_rows(file.create_group("outliers"), SuspectReading, solution.readings.outlier_readings)
        write_adequacy(file.create_group("adequacy"), solution.adequacy)
        if solution.variance_components:
            write_variance_components(file.create_group("variance_components"), solution)
        for name in ("n_readings", "n_parameters", "iterations", "converged"):
            file.require_group("statistics").attrs[name] = getattr(solution.statistics, name)
        write_text(file, "notes", list(solution.notes))
        file.create_group("provenance").attrs.update(solution.provenance)
        if solution.samples is not None:
            write_samples(file.create_group("monte_carlo"), solution.samples, np.asarray(solution.covariance).shape[0])


def read_solution(path: str | Path) -> Solution:
    """The solution stored in an HDF5 file: same parameters, deviations and covariance to the last bit.

    Args:
        path: Path of a file that `volid.save_solution` or `volid fit` has written.

    Raises:
        InputError: the file is missing, truncated, not HDF5, of another type or version, or incomplete; or this version builds
            another error model from the machine and datum in it.

    >>> import volid
    >>> path = getfixture("tmp_path") / "solution.h5"
    >>> solution = volid.fit(volid.load_campaign("datasets/published_positioning/campaign.toml"))
    >>> volid.save_solution(solution, path)
    >>> volid.load_solution(path).machine.name == solution.machine.name
    True
    """
    with reading(path, "solution", FORMAT) as file:
        campaign = read_campaign_group(file.group("campaign"))
        model = read_model(file, campaign)
        numbers = read_numbers(file, model)
        identifiability = file.group("identifiability")
        return Solution(
            **numbers._asdict(),
            model=model,
            campaign=campaign,
            nuisance_table=read_nuisance(file.group("nuisance"), campaign),
            adequacy=read_adequacy(file.group("adequacy"), campaign),
            statistics=read_statistics(file, campaign),
            readings=read_residuals(file, campaign),
            statements=tuple(identifiability.texts("statements").tolist()),
            undetermined=read_undetermined(identifiability.group("undetermined")),
            notes=tuple(file.texts("notes").tolist()),
            options=file.attributes.json("options", dict),
            samples=read_samples(file, len(numbers.covariance)),
            prior_root=read_prior(file, model),
            smooth=read_smoothness(file, numbers),
            variance_components=read_variance_components(file),
            provenance=file.group("provenance").attributes.all_texts(),
        )
