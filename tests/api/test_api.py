"""The API as other programs use it: schemathesis against the document that is served, and the recipes of docs/.

RISKAWARE_API_EXAMPLES says how many requests schemathesis makes up for each path (20).
"""

import os
import pathlib
import re
import shutil
import subprocess
import sys
import tempfile
import time
import unittest

import httpx

ROOT = pathlib.Path(__file__).resolve().parents[2]
PROGRAM = os.environ.get("RISKAWARE", ROOT / "target/debug/riskaware")
EXAMPLES = os.environ.get("RISKAWARE_API_EXAMPLES", "20")
RECIPES = ROOT / "docs/recipes"
# Until simulated people have finished and all fits are there; a slow machine needs minutes.
PATIENCE = 600


class Api(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        # Simulated people, quickly: what is tested is a server with answers, fits and draws.
        server = subprocess.Popen(
            [PROGRAM, "demo", "--listen", "127.0.0.1:0", "--people", "6", "--minutes", "0.05", "--thinking", "0.1",
             "--log", "error"],
            stdout=subprocess.PIPE, text=True,
        )
        cls.addClassCleanup(server.stdout.close)
        cls.addClassCleanup(server.wait)
        cls.addClassCleanup(server.terminate)
        for line in server.stdout:
            if found := re.search(r"http://\S+?(?=/results)", line):
                cls.api = f"{found[0]}/api/v1"
                break
        else:
            raise AssertionError("the server did not start")
        until = time.monotonic() + PATIENCE
        while not cls.is_settled():
            if time.monotonic() > until or server.poll() is not None:
                raise AssertionError("the server has no finished people and fits")
            time.sleep(0.5)

    @classmethod
    def is_settled(cls):
        summary = httpx.get(f"{cls.api}/studies/driving/summary").json()
        fits = summary["fits"]
        return summary["people"]["completed"] == 6 and all(
            fit["state"] == "converged" and not fit["is_behind"] and not fit["provisional"] for fit in fits
        )

    def run_recipe(self, *command, folder=None):
        done = subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=120)
        self.assertEqual(done.returncode, 0, f"{command}\n{done.stdout}\n{done.stderr}")
        return done.stdout

    def test_schemathesis_finds_nothing(self):
        # The fit whose draws are asked for; no list in a document could name it.
        fit = httpx.get(f"{self.api}/studies/driving/fits").json()["fits"][0]["id"]
        with tempfile.TemporaryDirectory() as folder:
            config = pathlib.Path(folder) / "schemathesis.toml"
            text = (ROOT / "tests/api/schemathesis.toml").read_text()
            config.write_text(text.replace("values = [1]", f"values = [{fit}, 999999]"))
            done = subprocess.run(
                [sys.executable, "-m", "schemathesis.cli", "--config-file", config, "run", f"{self.api}/openapi.json",
                 "--max-examples", EXAMPLES, "--seed", "1", "--checks", "all", "--continue-on-failure"],
                cwd=folder, capture_output=True, text=True,
            )
        self.assertEqual(done.returncode, 0, f"{done.stdout}\n{done.stderr}")

    def test_the_recipe_for_curl_runs(self):
        if shutil.which("curl") is None:
            self.skipTest("curl is missing")
        with tempfile.TemporaryDirectory() as folder:
            self.run_recipe("bash", RECIPES / "answers.sh", self.api, "driving", folder)
            rows = (pathlib.Path(folder) / "answers.csv").read_text().splitlines()
            paged = (pathlib.Path(folder) / "answers.ndjson").read_text().count('"participant"')
            self.assertEqual(len(rows) - 1, paged)
            # A second time nothing has changed, and the file stays.
            self.run_recipe("bash", RECIPES / "answers.sh", self.api, "driving", folder)
            self.assertIn('"data_version"', (pathlib.Path(folder) / "summary.json").read_text())

    def test_the_recipe_for_python_runs(self):
        printed = self.run_recipe(sys.executable, RECIPES / "answers.py", self.api, "driving")
        self.assertIn("explicit/timed/low", printed)
        self.assertIn("summary unchanged", printed)

    def test_the_recipe_for_r_runs(self):
        found = shutil.which("Rscript") and subprocess.run(
            ["Rscript", "-e", "library(httr2); library(readr)"], capture_output=True
        )
        if not found or found.returncode != 0:
            print("skipped: the recipe for R: R with httr2 and readr is missing")
            self.skipTest("R with httr2 and readr is missing")
        printed = self.run_recipe("Rscript", RECIPES / "answers.R", self.api, "driving")
        self.assertIn("explicit/timed/low", printed)
        self.assertIn("summary unchanged", printed)


if __name__ == "__main__":
    unittest.main()
