"""Files as instruments write them, read as their published truth says; none silently wrong.

The shared files are read where they are; `test_dialects.py` writes small ones of the same kinds.
"""

import importlib.util
import json
import os
from pathlib import Path

import numpy as np
import pytest

from barnax.errors import InputError
from barnax.records import read_record
from barnax.records.column_rules import examine_columns
from barnax.records.read import read_source
from barnax.records.table import examine_cells, take_lines

FOLDER = Path(os.environ.get("BARNAX_SHARED_DATA", "nowhere"), "formats")
TRUTH = FOLDER / "truth.json"
FILES = json.loads(TRUTH.read_text())["files"] if TRUTH.exists() else []
RECORDS = [each for each in FILES if "n_rows" in each]
OTHERS = [each for each in FILES if "n_rows" not in each]
# What reads them stands in an extra.
EXTRAS = {".mpr": "galvani", ".res": "access_parser", ".gz": "access_parser"}
# Files that are wrong by themselves, and what is said of them.
REFUSED = {
    "example_data.csv": "time is out of line",
    "DLR__LiLNMOHydra0b__20221125__POCV__25degC__Basytec.bdf.csv": "hours, .* divide it by 3600",
    "faraday__lg-INR21700M50-2019-002__2019-06-02__rate__25degC__maccor.bdf.csv": "has no sign",
}
READ_WITH_A_REMARK = {
    "Unit27_Example_Corrupt.ndax": "is damaged",
    "maccor_test_file_4267-66-6519.041": "61 rows of an impedance measurement",
}

pytestmark = pytest.mark.skipif(not FILES, reason="needs the shared files of other instruments")


def by_name(entries):
    return [pytest.param(each, id=Path(each["file"]).name) for each in entries]


def path_of(entry):
    path = FOLDER / entry["file"]
    package = EXTRAS.get(path.suffix)
    if package and importlib.util.find_spec(package) is None:
        pytest.skip(f"needs {package}")
    return path


@pytest.mark.parametrize(
    "truth", by_name(each for each in RECORDS if Path(each["file"]).name not in REFUSED)
)
def test_a_record_is_read_as_it_is(truth):
    source = read_source(path_of(truth))
    columns, _ = examine_columns(source.table, source.name)
    lines, _ = examine_cells(take_lines(source.table, columns))
    assert len(lines.row) == truth["n_rows"]

    record = read_record(source)
    charge_a, peak_a = -record.current_a, np.abs(record.current_a).max()
    ends = [record.time_s[0], record.time_s[-1]]
    np.testing.assert_allclose(ends, [truth["t_first_s"], truth["t_last_s"]], rtol=0, atol=1e-3)
    ranges = [charge_a.min(), charge_a.max()]
    expected = [truth["i_min_A"], truth["i_max_A"]]
    np.testing.assert_allclose(ranges, expected, rtol=0, atol=1e-5 * peak_a + 1e-12)
    ranges = [record.voltage_v.min(), record.voltage_v.max()]
    np.testing.assert_allclose(ranges, [truth["v_min_V"], truth["v_max_V"]], rtol=0, atol=1e-5)
    for row in truth["rows_to_check"]:
        # A row that repeats the one before stands in the record once.
        at = np.searchsorted(record.time_s, row["t_s"] - 1e-3)
        near = slice(at, at + 8)
        matches = (
            (np.abs(record.time_s[near] - row["t_s"]) <= 1e-3)
            & (np.abs(charge_a[near] - row["i_A"]) <= 1e-5 * peak_a + 1e-12)
            & (np.abs(record.voltage_v[near] - row["v_V"]) <= 1e-5)
        )
        assert matches.any(), row


@pytest.mark.parametrize(
    "truth", by_name(each for each in RECORDS if Path(each["file"]).name in REFUSED)
)
def test_a_file_that_is_wrong_is_refused_with_what_to_do(truth):
    path = path_of(truth)
    with pytest.raises(InputError, match=f"^{path.name}: row .*{REFUSED[path.name]}") as caught:
        read_record(path)
    assert "; " in str(caught.value)


@pytest.mark.parametrize("other", by_name(OTHERS))
def test_what_is_no_record_is_refused_or_remarked_on(other):
    path = path_of(other)
    if path.name in READ_WITH_A_REMARK:
        said = " ".join(read_record(path).warnings)
        assert READ_WITH_A_REMARK[path.name] in said
        return
    with pytest.raises(InputError, match=rf"^{path.name}: .*(give|export|Export)"):
        read_record(path)


def test_at_least_fifty_of_the_records_are_read():
    assert len(RECORDS) - len(REFUSED) >= 50
