"""Draws as other programs read them: ArviZ and cmdstanpy must find the numbers that `riskaware fit` prints."""

import json
import logging
import os
import pathlib
import subprocess
import tempfile
import unittest
import warnings

import arviz
import cmdstanpy
import numpy

ROOT = pathlib.Path(__file__).resolve().parents[2]
PROGRAM = os.environ.get("RISKAWARE", ROOT / "target/debug/riskaware")
EXAMPLE = ROOT / "examples/kahneman-tversky-1979"
DIAGNOSTICS = {
    "rhat": arviz.rhat,
    "ess_bulk": lambda draws: arviz.ess(draws, method="bulk"),
    "ess_tail": lambda draws: arviz.ess(draws, method="tail"),
    "mcse_mean": lambda draws: arviz.mcse(draws, method="mean"),
    "mcse_q50": lambda draws: arviz.mcse(draws, method="quantile", prob=0.5),
}


class Draws(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        logging.getLogger("cmdstanpy").setLevel(logging.ERROR)
        warnings.simplefilter("ignore")
        folder = tempfile.TemporaryDirectory()
        cls.addClassCleanup(folder.cleanup)
        cls.folder = pathlib.Path(folder.name)
        printed = subprocess.run(
            [
                PROGRAM, "fit", "--json", "--seed", "3",
                "--problems", EXAMPLE / "problems.json",
                "--choices", EXAMPLE / "choices.csv",
                "--draws-dir", cls.folder,
            ],
            check=True, capture_output=True, text=True,
        )
        cls.models = json.loads(printed.stdout)["models"]

    def arviz_json(self, model):
        return arviz.from_json(self.folder / f"{model}.json")

    def arviz_csv(self, model):
        return arviz.from_cmdstan(str(self.folder / f"{model}-*.csv"))

    def check(self, draws, stated, what):
        for name, diagnostic in DIAGNOSTICS.items():
            if name in stated:
                found = float(diagnostic(draws))
                self.assertLess(abs(found / stated[name] - 1), 1e-6, f"{what}: {name} {found} {stated[name]}")

    def test_diagnostics_of_parameters_agree(self):
        for model, fit in self.models.items():
            for read in (self.arviz_json(model), self.arviz_csv(model)):
                for name, stated in fit["parameters"].items():
                    draws = read.posterior[name].values
                    self.assertEqual(draws.shape, (8, 500))
                    self.check(draws, stated, f"{model} {name}")
                    self.assertAlmostEqual(draws.mean() / stated["mean"], 1, places=9)

    def test_diagnostics_of_probabilities_agree(self):
        for model, fit in self.models.items():
            read = self.arviz_json(model)
            for problem, stated in fit["diagnostics"]["predicted"].items():
                of_problem = read.posterior["p"].values[:, :, read.constant_data["option_problem"].values == problem]
                # The less likely of two actions; the other's differ by rounding.
                draws = of_problem[:, :, numpy.log(of_problem).sum(axis=(0, 1)).argmin()]
                if numpy.ptp(draws) > 1e-12:
                    self.check(draws, stated, f"{model} {problem}")
            for problem, actions in fit["predicted"].items():
                for action, share in actions.items():
                    found = float(read.posterior["p"].sel(option=f"{problem}:{action}").mean())
                    self.assertAlmostEqual(found, share["mean"], places=12)

    def test_both_files_hold_the_same_numbers(self):
        for model in self.models:
            first, second = self.arviz_json(model), self.arviz_csv(model)
            for name in second.posterior:
                numpy.testing.assert_array_equal(first.posterior[name].values, second.posterior[name].values)
            numpy.testing.assert_array_equal(first.sample_stats["lp"].values, second.sample_stats["lp"].values)

    def test_likelihoods_stand_beside_the_counts_that_made_them(self):
        for model, fit in self.models.items():
            read = self.arviz_json(model)
            counts, p = read.observed_data["count"].values, read.posterior["p"].values
            by_hand = (counts * numpy.log(p)).sum(axis=2)
            by_problem = read.log_likelihood["by_problem"].values.sum(axis=2)
            weights = read.constant_data["pattern_weight"].values
            by_pattern = (read.log_likelihood["by_pattern"].values * weights).sum(axis=2)
            numpy.testing.assert_allclose(by_problem, by_hand, rtol=1e-9)
            numpy.testing.assert_allclose(by_pattern, by_hand, rtol=1e-9)
            self.assertLessEqual(by_hand.max(), fit["max_log_likelihood"] + 1e-9)

    def test_leaving_one_out_is_one_call(self):
        read = self.arviz_json("risk_aware")
        weights = read.constant_data["pattern_weight"].values
        people = read.log_likelihood["by_pattern"].isel(pattern=numpy.repeat(numpy.arange(len(weights)), weights))
        read.log_likelihood = people.to_dataset()
        found = arviz.loo(read, var_name="by_pattern")
        self.assertEqual(found.n_data_points, int(read.observed_data["count"].sum()))
        self.assertLess(found.elpd_loo, self.models["risk_aware"]["max_log_likelihood"])

    def test_the_prior_stands_beside_the_posterior(self):
        read = self.arviz_json("risk_aware")
        for name, stated in self.models["risk_aware"]["parameters"].items():
            self.assertAlmostEqual(numpy.median(read.prior[name].values) / stated["prior_q50"], 1, places=1)

    def test_attributes_say_what_was_fitted(self):
        attributes = self.arviz_json("risk_aware").attrs
        self.assertEqual(attributes["inference_library"], "riskaware")
        self.assertEqual((attributes["seed"], attributes["choices"]), (3, 1064))
        self.assertEqual(attributes["prior_gamma"], "uniform(0.28,1)")

    def test_cmdstanpy_reads_the_chains(self):
        read = cmdstanpy.from_csv(str(self.folder / "risk_aware-*.csv"))
        options = self.arviz_json("risk_aware").posterior.sizes["option"]
        self.assertEqual(read.stan_variable("p").shape, (4000, options))
        self.assertEqual(sorted(read.stan_variables())[:3], ["alpha", "beta", "delta"])


if __name__ == "__main__":
    unittest.main()
