"""Files as instruments write them, read as their published truth says; none silently wrong.

The shared files are read where they are; `test_dialects.py` writes small ones of the same kinds.
"""

import os
from pathlib import Path

import pytest
from benchmarks.formats import missing_package, outcome_of, truths

from barnax import InputError
from helpers.records import read

FOLDER = Path(os.environ.get("BARNAX_SHARED_DATA", "nowhere"), "formats")
FILES = truths(FOLDER)
RECORDS = [each for each in FILES if "n_rows" in each]
OTHERS = [each for each in FILES if "n_rows" not in each]
# Files that are wrong by themselves, and what is said of them.
REFUSED = {
    "example_data.csv": "time is out of line",
    "DLR__LiLNMOHydra0b__20221125__POCV__25degC__Basytec.bdf.csv": "divide it by 3600",
    "faraday__lg-INR21700M50-2019-002__2019-06-02__rate__25degC__maccor.bdf.csv": "has no sign",
}
READ_WITH_A_REMARK = {
    "Unit27_Example_Corrupt.ndax": "is damaged",
    "maccor_test_file_4267-66-6519.041": "61 rows of an impedance measurement",
}

pytestmark = pytest.mark.skipif(not FILES, reason="needs the shared files of other instruments")


def by_name(entries):
    return [pytest.param(each, id=Path(each["file"]).name) for each in entries]


def outcome(truth):
    if package := missing_package(truth):
        pytest.skip(f"needs {package}")
    return outcome_of(FOLDER, truth)


@pytest.mark.parametrize("truth", by_name(RECORDS))
def test_a_record_is_read_as_it_is_or_refused_with_what_to_do(truth):
    actual, name = outcome(truth), Path(truth["file"]).name
    if name not in REFUSED:
        assert actual.word == "agrees"
        return
    place, what = actual.refusal.split(": ", 2)[1:]
    assert place.startswith("row ")
    assert REFUSED[name] in what
    assert "; " in what


@pytest.mark.parametrize("other", by_name(OTHERS))
def test_what_is_no_record_is_refused_or_remarked_on(other):
    actual, name = outcome(other), Path(other["file"]).name
    if name in READ_WITH_A_REMARK:
        assert READ_WITH_A_REMARK[name] in " ".join(map(str, actual.warnings))
        return
    assert actual.refusal.startswith(f"{name}: ")
    assert any(word in actual.refusal.lower() for word in ("give", "export"))


def test_at_least_fifty_of_the_records_are_read():
    assert len(RECORDS) - len(REFUSED) >= 50


@pytest.mark.parametrize("name", ["TestFile.nda", "nda_v22.nda"])
@pytest.mark.parametrize("share", [0.1, 0.5, 0.99])
def test_a_neware_file_that_is_cut_short_is_refused(tmp_path, name, share):
    content = (FOLDER / "neware" / name).read_bytes()
    with pytest.raises(InputError, match=r"is cut short: it has [\d,]+ bytes of"):
        read(tmp_path, content[: int(share * len(content))], "cell.nda")
