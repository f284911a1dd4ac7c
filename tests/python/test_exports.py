"""Exports as pandas reads them: tables, codebook and the Psych-DS archive of a study with imported answers."""

import hashlib
import io
import json
import os
import pathlib
import sqlite3
import subprocess
import tempfile
import unittest
import zipfile

import pandas

ROOT = pathlib.Path(__file__).resolve().parents[2]
PROGRAM = os.environ.get("RISKAWARE", ROOT / "target/debug/riskaware")
CELLS = [
    f"{information}/untimed/{risk}" for information in ("implicit", "explicit") for risk in ("low", "high")
]


class Exports(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        folder = tempfile.TemporaryDirectory()
        cls.addClassCleanup(folder.cleanup)
        cls.folder = pathlib.Path(folder.name)
        cls.database = cls.folder / "riskaware.db"
        cls.make_database()
        answers = cls.folder / "answers.csv"
        rows = [
            f"{person},{cell},{'stop' if (person + place) % 3 else 'accelerate'},{1500 + 10 * person}"
            for person in range(20)
            for place, cell in enumerate(CELLS)
        ]
        answers.write_text("participant,problem,action,client_rt_ms\n" + "\n".join(rows) + "\n")
        cls.run_program("import", "driving", "--file", answers, "--source", "=lab", "--database", cls.database)
        cls.exports = {
            form: cls.export(form) for form in ("long", "wide", "ndjson", "codebook", "psych-ds", "bonus", "analysis")
        }

    @classmethod
    def make_database(cls):
        """Lets a server make the database and publish the built-in studies."""
        server = subprocess.Popen(
            [PROGRAM, "serve", "--listen", "127.0.0.1:0", "--database", cls.database],
            stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True,
        )
        try:
            # It tells its address once everything is ready.
            server.stdout.readline()
        finally:
            server.terminate()
            server.wait()
            server.stdout.close()

    @classmethod
    def run_program(cls, *arguments):
        done = subprocess.run([PROGRAM, *map(str, arguments)], capture_output=True)
        if done.returncode != 0:
            raise AssertionError(done.stderr.decode())
        return done.stdout

    @classmethod
    def export(cls, form):
        return cls.run_program("export", "driving", "--format", form, "--database", cls.database)

    def table(self, form):
        # As docs/DATA.md says: nothing but the empty cell is missing.
        return pandas.read_csv(io.BytesIO(self.exports[form]), keep_default_na=False, na_values=[""])

    def test_long_and_wide_tell_the_same(self):
        long, wide = self.table("long"), self.table("wide")
        self.assertEqual(len(long), 20 * len(CELLS))
        self.assertEqual(list(wide["participant"]), sorted(long["participant"].unique()))
        self.assertEqual(set(long["risk"]), {"low", "high"})
        self.assertEqual(set(long["source"]), {"'=lab"})
        self.assertTrue(pandas.api.types.is_integer_dtype(long["client_rt_ms"]))
        for _, row in long.iterrows():
            cell = wide.loc[wide["participant"] == row["participant"], f"{row['block']}.{row['question']}.action"]
            self.assertEqual(cell.item(), row["action"])
        lines = [json.loads(line) for line in self.exports["ndjson"].splitlines()]
        self.assertEqual([line["action"] for line in lines], list(long["action"]))

    def test_every_answer_names_its_study_file(self):
        wide = self.table("wide")
        lines = pandas.read_json(io.BytesIO(self.exports["ndjson"]), lines=True)
        hashes = {version["hash"] for version in [json.loads(self.exports["analysis"])["analysis"]["study"]]}
        self.assertEqual(set(wide["study_version_hash"]), hashes)
        self.assertEqual(set(lines["study_version_hash"]), hashes)
        # They answered elsewhere.
        self.assertTrue(wide["program_version"].isna().all())
        self.assertTrue(lines["counted"].all())
        self.assertFalse(lines["practice"].any())
        self.assertTrue(pandas.api.types.is_integer_dtype(wide["last_position"]))
        self.assertTrue(pandas.api.types.is_bool_dtype(wide["simulated"]))

    def test_columns_are_of_the_types_that_the_codebook_says(self):
        codebook = self.table("codebook")
        for name, form in (("answers", "long"), ("participants", "wide")):
            table = self.table(form)
            for _, column in codebook[codebook["table"] == name].iterrows():
                values = table[column["column"]].dropna()
                if len(values) and column["type"] in ("integer", "number"):
                    self.assertTrue(pandas.api.types.is_numeric_dtype(values), column["column"])
                if len(values) and column["type"] == "level":
                    known = {level.split(" = ")[0] for level in column["levels"].split("; ")}
                    self.assertLessEqual(set(values.astype(str)), known, column["column"])

    def test_the_codebook_describes_every_column(self):
        codebook = self.table("codebook")
        for name, form in (("answers", "long"), ("participants", "wide")):
            columns = codebook[codebook["table"] == name]
            self.assertEqual(list(columns["column"]), list(self.table(form).columns))
            self.assertFalse(columns[["label", "description", "type"]].isna().any().any())

    def test_the_archive_is_a_psych_ds_dataset(self):
        archive = zipfile.ZipFile(io.BytesIO(self.exports["psych-ds"]))
        self.assertIsNone(archive.testzip())
        description = json.loads(archive.read("dataset_description.json"))
        measured = [variable["name"] for variable in description["variableMeasured"]]
        self.assertEqual(len(measured), len(set(measured)))
        columns = set()
        for name in archive.namelist():
            self.assertGreater(archive.getinfo(name).file_size, 0, name)
            if name.startswith("data/"):
                self.assertRegex(name[5:], r"^([a-z]+-[a-zA-Z0-9]+)(_[a-z]+-[a-zA-Z0-9]+)*_data\.csv$")
                columns |= set(pandas.read_csv(io.BytesIO(archive.read(name))).columns)
        self.assertEqual(set(measured), columns)
        for entry in json.loads(archive.read("documentation/manifest.json"))["files"]:
            contents = archive.read(entry["path"])
            self.assertEqual(entry["sha256"], hashlib.sha256(contents).hexdigest())
            if entry["path"].startswith("data/"):
                self.assertEqual(entry["rows"], len(pandas.read_csv(io.BytesIO(contents))))

    def test_the_same_data_are_the_same_bytes(self):
        for form, before in self.exports.items():
            self.assertEqual(self.export(form), before, form)

    def test_the_analysis_carries_its_hash(self):
        text = self.exports["analysis"].decode()
        analysis = json.loads(text)
        self.assertEqual(analysis["sha256"], hashlib.sha256(text.split("\n")[1].encode()).hexdigest())
        self.assertFalse(analysis["analysis"]["is_complete"])

    def test_a_copy_is_a_database_and_is_well(self):
        copy = self.folder / "copy.db"
        self.run_program("backup", copy, "--database", self.database)
        with sqlite3.connect(copy) as connection:
            self.assertEqual(connection.execute("select count(*) from run").fetchone(), (20,))
        report = json.loads(self.run_program("doctor", "--json", "--database", self.database))
        self.assertTrue(report["healthy"], report)


if __name__ == "__main__":
    unittest.main()
