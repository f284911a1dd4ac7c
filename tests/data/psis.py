"""Writes psis.json: Pareto-smoothed weights and leave-one-out scores as ArviZ computes them.

    pip install arviz==0.23.4
    python tests/data/psis.py > tests/data/psis.json
"""

import json

import arviz
import numpy
import xarray

rng = numpy.random.default_rng(20090904)


def weights(name, ln_ratios, relative_efficiency=1.0):
    smoothed, shape = arviz.psislw(numpy.array(ln_ratios), relative_efficiency)
    return {
        "name": name,
        "relative_efficiency": relative_efficiency,
        "ln_ratios": [float(x) for x in ln_ratios],
        "ln_weights": [float(x) for x in smoothed],
        "shape": float(shape) if numpy.isfinite(shape) else None,
    }


cases = [weights(f"pareto, k = {k}", k * rng.exponential(size=200), 1.0) for k in (0.1, 0.5, 0.7, 1.2)]
cases.append(weights("bounded", -numpy.log(rng.uniform(0.5, 1.0, size=300)), 1.0))
cases.append(weights("efficiency 0.4", rng.normal(size=250), 0.4))
cases.append(weights("efficiency 1.6", 40.0 + 2.0 * rng.normal(size=250), 1.6))
cases.append(weights("repeated draws", numpy.repeat(rng.normal(size=60), 4), 0.3))
cases.append(weights("far apart", 300.0 * rng.normal(size=150), 1.0))
cases.append(weights("too few", rng.normal(size=15), 1.0))

# Eight people answer 1 to 4 times with one unknown probability each, four chains of 100 draws.
chains, draws = 4, 100
probability = rng.beta(6.0, 4.0, size=(chains, draws))
successes, trials = [0, 1, 2, 4, 3, 1, 0, 2], [1, 1, 3, 4, 4, 2, 2, 2]
ln_likelihood = numpy.stack(
    [s * numpy.log(probability) + (t - s) * numpy.log1p(-probability) for s, t in zip(successes, trials)], axis=-1
)
data = arviz.from_dict(posterior={"p": probability}, log_likelihood={"y": ln_likelihood})
found = arviz.loo(data, pointwise=True, reff=0.9)
leave_one_out = {
    "relative_efficiency": 0.9,
    "ln_likelihood": ln_likelihood.reshape(chains * draws, -1).T.tolist(),
    "elpd": float(found.elpd_loo),
    "se": float(found.se),
    "effective_parameters": float(found.p_loo),
    "pointwise": found.loo_i.values.tolist(),
    "shapes": found.pareto_k.values.tolist(),
}
assert isinstance(found.loo_i, xarray.DataArray)
print(json.dumps({"arviz": arviz.__version__, "weights": cases, "leave_one_out": leave_one_out}))
