"""`Result.load`: a stored result with its records again draws what it drew when it was made."""

import hashlib
import json
import shutil

import numpy as np
import polars as pl
import pytest

import barnax
from barnax import InputError, Result, Window, read_record
from barnax.bundled import BUNDLED
from barnax.reopening import StoredInputs
from barnax.reporting.illustrations import identification_illustrations

SMALL = {"seeds": 2, "population": 8, "iterations": 5, "trust": "none"}
# Names and content that the bundled cell has not.
FILES = {"drive.parquet": BUNDLED.record, "other.parquet": BUNDLED.validation}


@pytest.fixture(scope="module")
def kept(tmp_path_factory):
    """A result with tables over SOC, its folder, and the folder of its files."""
    data, folder = tmp_path_factory.mktemp("data"), tmp_path_factory.mktemp("out")
    for name, path in FILES.items():
        pl.read_parquet(path)[:6000].write_parquet(data / name)
    result = barnax.identify(
        data / "drive.parquet", ocv=list(BUNDLED.ocv), validate=data / "other.parquet",
        model="iso-rc", over="soc", window=Window(score_to_s=1500.0), **SMALL,
    )  # fmt: skip
    (folder / "result.json").write_text(result.to_json())
    return result, folder, data


def same(one, other):
    np.testing.assert_array_equal(one.simulated_v, other.simulated_v)
    np.testing.assert_array_equal(one.prepared.soc, other.prepared.soc)
    for each in ("start", "window"):
        assert getattr(one.prepared, each) == getattr(other.prepared, each)
    assert one.metrics == other.metrics


def test_a_loaded_result_has_the_evaluations_and_figures_of_the_run(kept):
    result, folder, data = kept
    loaded = Result.load(folder, data=data)
    for before, after in ((result, loaded), (result.without_tables(), loaded.without_tables())):
        both = [
            (*each.identification, *each.validation)
            for each in (before.evaluations, after.evaluations)
        ]
        for one, other in zip(*both, strict=True):
            same(one, other)
    names = [[each.name for each in identification_illustrations(own)] for own in (result, loaded)]
    assert names[0] == names[1]
    assert {"ocv", "tables"} < set(names[1])


@pytest.mark.slow
def test_a_loaded_result_writes_the_same_report(kept, tmp_path):
    result, folder, data = kept
    page = Result.load(folder / "result.json", data=[data]).report(tmp_path / "new" / "report.md")
    assert (tmp_path / "new" / "report.md").read_text() == page == result.report(format="md")
    pictures = {path.name for path in (tmp_path / "new" / "figures").iterdir()}
    assert pictures
    assert all(f"(figures/{name})" in page for name in pictures)
    assert "</html>" in result.report()
    assert len(repr(result.report())) < 100
    with pytest.raises(InputError, match="is html or md, not 'docx'"):
        result.report("report.docx")


def test_files_are_looked_for_beside_the_result_and_named_where_they_are_not(kept, tmp_path):
    _, folder, data = kept
    stored = Result.load(folder)
    with pytest.raises(InputError, match=r"drive\.parquet: not found in .*with `data`"):
        stored.figure("voltage")
    # What needs no record is there all the same.
    assert stored.to_frame().height == len(stored.fit.tables.nodes)
    for path in (folder / "result.json", *data.iterdir()):
        shutil.copy(path, tmp_path)
    assert len(Result.load(tmp_path).evaluations.identification) == 1
    shutil.copy(BUNDLED.record, tmp_path / "drive.parquet")
    with pytest.raises(InputError, match=r"drive\.parquet: not the file .*SHA-256 differs"):
        _ = Result.load(tmp_path).evaluations


def test_what_no_longer_gives_the_stored_error_is_refused(kept, tmp_path):
    _, folder, data = kept
    document = json.loads((folder / "result.json").read_text())
    document["constant"]["parameters"]["R0 [Ohm]"] *= 1.01
    (tmp_path / "result.json").write_text(json.dumps(document))
    with pytest.raises(InputError, match=r"the stored iso-rc leaves .* identify again"):
        _ = Result.load(tmp_path, data=data).evaluations


def test_validation_is_of_what_is_the_answer(kept):
    result, folder, data = kept
    actual = Result.load(folder).validate(data / "other.parquet")
    assert actual.metrics.rmse_v == result.metrics.validation[0].rmse_v
    constant = result.without_tables().validate(read_record(data / "other.parquet"))
    assert constant.metrics.rmse_v == result.constant.metrics.validation[0].rmse_v


def test_files_are_read_where_the_plan_beside_a_result_says_and_recognized_by_content(tmp_path):
    files, out = tmp_path / "files", tmp_path / "results" / "out"
    files.mkdir()
    out.mkdir(parents=True)
    record = files / "drive.parquet"
    shutil.copy(BUNDLED.record, record)
    sha256 = hashlib.sha256(record.read_bytes()).hexdigest()
    why = StoredInputs.of(out).find("drive.parquet", sha256)
    assert "drive.parquet: not found in" in str(why)
    (out / "plan.toml").write_text(
        f'[[files]]\nfile = "{record.as_posix()}"\nrole = "identification"\n'
    )
    assert StoredInputs.of(out).find("drive.parquet", sha256) == record
    # Another's plan names what it likes: without a digest, nothing is taken from there.
    why = StoredInputs.of(out).find("drive.parquet", "")
    assert "not found in" in str(why)
    shutil.copy(BUNDLED.validation, record)
    why = StoredInputs.of(out).find("drive.parquet", sha256)
    assert "SHA-256 differs" in str(why)
