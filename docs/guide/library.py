# %% [markdown]
# # pido as a library
#
# `library.ipynb` is the notebook for Jupyter; `library.py` is the script with the same cells, and a test runs it as it
# stands. They need nothing but the package: no server, no Prefect, no MLflow.

# %%
import numpy as np
from sklearn.ensemble import ExtraTreesRegressor
from sklearn.metrics import root_mean_squared_error

from pido.config import machine
from pido.core.columns import CURRENT, INPUTS
from pido.core.tables import table_of
from pido.diagnosis.correct import correct
from pido.diagnosis.diagnose import diagnose
from pido.equations.estimators import LocalPhysicalEquations, PhysicalEquation
from pido.files.samples import frame
from pido.process.samples import to_samples
from pido.sampling.front import PiDOSampler
from pido.synthetic.cases import draw_case

# %% [markdown]
# ## Recordings
#
# Four parts of a simulated mill that has a torque ripple which its simulation lacks. Your own parts:
# `read_recording(Path("parts/p01"))` from `pido.recordings`, for any format that `pido ingest` reads.

# %%
case = draw_case("torque_ripple", strength=3.0, seed=1, parts=4)
recordings = [part.recording for part in case.parts]
first = recordings[0]
print(f"{first.part.part}: {len(first)} samples at {first.sample_rate_hz:.0f} Hz")

# a table with units, in the library that you work with: "pandas", "polars" or "pyarrow"
table = table_of({name: first[name] for name in ("time", "v_x", "curr_x")}, "pandas")
print(table.attrs["units"])

# %% [markdown]
# ## Samples: the 13 inputs and the currents
#
# `direction_*` is the sign of each axis' last motion: at standstill the friction keeps it, and no velocity shows it.

# %%
mill = machine(first.part.machine)
rows = [frame(to_samples(r, mill, r.part.part)) for r in recordings]
inputs = [*INPUTS, "ar", *(name for name in rows[0] if name.startswith("dir_"))]
known, coming = rows[0], rows[1]
X, y = known[inputs], known[list(CURRENT.values())]

# %% [markdown]
# ## A physical equation, for all samples or one per region

# %%
one = PhysicalEquation(mill).fit(X, y)
local = LocalPhysicalEquations(mill).fit(X, y)
current, standard_error = local.predict(coming[inputs], return_std=True)
for name, model in (("one equation", one), ("one per bin", local)):
    error = root_mean_squared_error(coming[list(CURRENT.values())], model.predict(coming[inputs]))
    print(f"{name}: {error:.3f} A on a part that it has not seen")
for term in ("held(v_x)", "v_x", "a_x"):
    print(f"x: {one.coefficients_[0, one.term_names_.index(term)]:+.4g} A per unit of {term}")

# %% [markdown]
# ## PiDO: rows that the coming part needs, before it is made
#
# `path` is the coming part's motion (from a program: `pido simulate`); its currents are not needed. The gate lets no
# row through that the equation has no support for, so there may be few, or none. `sample_origin_` says of every row
# where it comes from.

# %%
sampler = PiDOSampler(mill, path=coming[inputs], random_state=0)
more_X, more_y = sampler.fit_resample(X, y)
kinds, counts = np.unique(sampler.sample_origin_["origin"], return_counts=True)
print(", ".join(f"{count} {kind}" for kind, count in zip(kinds, counts, strict=True)))
print(sampler.report_.summary())

# generated rows are for training only: the test is always on rows that a machine has recorded
model = ExtraTreesRegressor(30, min_samples_leaf=5, random_state=0)
model.fit(more_X, more_y, sample_weight=sampler.sample_weight_)
error = root_mean_squared_error(coming[list(CURRENT.values())], model.predict(coming[inputs]))
print(f"a forest with these rows: {error:.3f} A on the part that they were made for")

# %% [markdown]
# ## What did the simulation leave out?
#
# Each recording brings what its simulation predicts (`curr_x_sim`, …). Where there is none, the physical equation that
# is fitted on the same parts stands for the simulation.

# %%
diagnosis = diagnose(recordings[:3])
for finding in diagnosis.findings:
    print(f"{finding.axis:<3} {finding.mechanism:<24} {finding.where.summary}")
    for name, estimate in finding.parameters.items():
        low, high = estimate.ci95
        print(f"      {name} = {estimate.value:.3g} {estimate.unit}  (95 %: {low:.3g} to {high:.3g})")
for note in diagnosis.notes:
    print(note)
for effect in case.truth()["effects"]:
    print(f"concealed was: {effect['axis']} {effect['mechanism']} {effect['parameters']}")

# %%
unseen = recordings[3]
corrected = correct(diagnosis.model, unseen)
for axis, values in corrected.corrected.items():
    before = root_mean_squared_error(unseen[CURRENT[axis]], unseen[f"curr_{axis}_sim"])
    after = root_mean_squared_error(unseen[CURRENT[axis]], values)
    print(f"{axis}: {before:.4f} -> {after:.4f} A on a part that was not diagnosed")
