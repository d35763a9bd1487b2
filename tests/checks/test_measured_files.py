"""What the README of the measured cells says of each file is found, and no more counts."""

import pytest

from barnax.checks import check_file
from helpers.records import counting, found

CALCE, PLETT, LEAF = "calce-inr18650-20r", "plett-a123-26650", "nissan-leaf-lmo-33ah"
DRIVES = [
    f"{CALCE}/{profile}_{degc}degC_{soc}soc_SP20-2.parquet"
    for profile, degc, soc in (
        ("dst", 25, 80),
        ("dst", 25, 50),
        ("dst", 0, 80),
        ("dst", 45, 80),
        ("us06", 25, 80),
        ("us06", 25, 50),
        ("us06", 0, 80),
        ("us06", 45, 80),
    )
]
# How many samples follow the one before within 0.05 s, by that README.
CLOSE = dict(zip(DRIVES, (24, 13, 26, 23, 14, 10, 11, 17), strict=True))
LOW_CURRENT = f"{CALCE}/ocv-low-current_25degC_SP20-1.parquet"
INCREMENTAL = f"{CALCE}/ocv-incremental_25degC_SP20-3.parquet"
PART3 = f"{CALCE}/ocv-incremental-part3_25degC_SP20-1.parquet"
DYNAMIC = [f"{PLETT}/dyn-s{number}_25degC.parquet" for number in (1, 2, 3)]
OCV = [f"{PLETT}/ocv-s{number}_25degC.parquet" for number in (1, 2, 3, 4)]
LEAVES = [f"{LEAF}/{name}.parquet" for name in ("hppc_25degC", "discharge-1c", "discharge-3c")]
DST_80 = "raw/11_05_2015_SP20-2_DST_80SOC.xls"
DST_50 = "raw/11_05_2015_SP20-2_DST_50SOC.with-extra-sheets.xls"
ARBIN_CSV = "raw/12_2_2015_Incremental OCV test_SP20-13.csv"
PLETT_CSV = "raw/A123_DYN_50_P25_s2.csv"
LEAF_CSV = "raw/leaf-cell-discharge-bitrode-1c.csv"
RAW = [DST_80, DST_50, ARBIN_CSV, PLETT_CSV, LEAF_CSV]

# Everything that counts, in all files; the rest is clean.
FINDINGS = {
    LOW_CURRENT: {"closure": "warning"},
    **{file: {"sign": "warning"} for file in DYNAMIC},
}
FILES = [*DRIVES, LOW_CURRENT, INCREMENTAL, PART3, *DYNAMIC, *OCV, *LEAVES, *RAW]
DIAGNOSES = {}


@pytest.fixture
def diagnosis(real_data, request):
    file = request.param
    if file not in DIAGNOSES:
        DIAGNOSES[file] = check_file(real_data / file)
    return DIAGNOSES[file]


def of(*files):
    """Run a test on the diagnosis of each of these files."""
    return pytest.mark.parametrize("diagnosis", files, indirect=True)


def roles(diagnosis):
    return {role.name: role for role in diagnosis.roles}


def words(diagnosis, check):
    return "; ".join(finding.what for finding in diagnosis.findings if finding.check == check)


@pytest.mark.parametrize("file", FILES)
def test_a_measured_file_has_the_findings_it_should_have_and_no_others(real_data, file):
    assert counting(check_file(real_data / file)) == FINDINGS.get(file, {})


def test_every_measured_file_is_listed_here(real_data):
    tables = {str(path.relative_to(real_data)) for path in real_data.glob("*/*.*")}
    assert tables == set(FILES)


@pytest.mark.parametrize("file", CLOSE)
def test_samples_hard_upon_another_are_counted(real_data, file):
    assert f"{CLOSE[file]} samples within" in found(check_file(real_data / file), "repeats").what


@of(*DRIVES, DST_80, DST_50)
def test_a_calce_drive_test_is_cut_to_its_profile(diagnosis):
    for role in ("identification", "validation"):
        assert roles(diagnosis)[role].options == (
            "--start-after-step 3",
            "`initial_soc` 1",
            "--score-steps 7,8",
        )
    assert not roles(diagnosis)["OCV test"].is_usable
    assert diagnosis.facts.current_hold == "backward"


@of(*DRIVES)
def test_only_the_us06_tests_at_25_degrees_start_unrelaxed(diagnosis):
    is_unrelaxed = diagnosis.file.startswith("us06_25degC")
    assert ("too short to settle" in roles(diagnosis)["identification"].reason) == is_unrelaxed


@of(LOW_CURRENT)
def test_the_low_current_test_does_not_close_and_hits_no_upper_cut_off(diagnosis):
    closure = found(diagnosis, "closure")
    assert "2.157 Ah out" in closure.what
    assert "1.926 Ah in" in closure.what
    assert "to 4.151 V" in closure.what
    assert "do not put both branches on one axis" in closure.remedy
    assert "slow discharge" in roles(diagnosis)["OCV test"].reason
    assert "slow charge" in roles(diagnosis)["OCV test"].reason


@of(LOW_CURRENT)
def test_the_low_current_test_has_five_rows_twice_a_gap_and_coarse_readings(diagnosis):
    assert "2 rows logged twice: exactly" in words(diagnosis, "repeats")
    assert "3 rows logged twice: the row before, within" in words(diagnosis, "repeats")
    assert "the longest 7 s before row 3" in found(diagnosis, "gaps").what
    assert "voltage in steps of 1 mV, current in steps of 1 mA" in words(diagnosis, "resolution")


def test_the_low_current_test_passes_more_than_the_capacity(real_data):
    diagnosis = check_file(real_data / LOW_CURRENT, capacity_ah=2.0)
    assert "2.157 Ah between its extremes, 107.8 %" in found(diagnosis, "capacity").what


@of(INCREMENTAL)
def test_the_incremental_test_has_a_rebuilt_clock_and_both_branches(diagnosis):
    assert "it was rebuilt, not logged" in found(diagnosis, "rebuilt clock").what
    ocv = roles(diagnosis)["OCV test"]
    assert ocv.is_usable
    assert "discharge by 11 rests, 1.996 Ah" in ocv.reason
    assert "charge by 12 rests, 1.972 Ah" in ocv.reason


@of(PART3, ARBIN_CSV)
def test_the_last_part_of_a_test_is_known_for_one(diagnosis):
    assert "1.416 Ah in and 1.987 Ah out" in found(diagnosis, "counters").what
    assert not any(role.is_usable for role in diagnosis.roles)


@of(*DYNAMIC)
def test_the_dynamic_a123_files_have_the_other_sign(diagnosis):
    assert "discharge-positive" in found(diagnosis, "sign").what
    assert "--current-sign discharge-positive" in found(diagnosis, "sign").remedy


@of(*OCV)
def test_the_a123_ocv_files_have_the_usual_sign_and_the_sweeps_are_known(diagnosis):
    assert not words(diagnosis, "sign")
    assert diagnosis.facts.current_sign == "charge-positive"
    is_sweep = diagnosis.file.startswith(("ocv-s1", "ocv-s3"))
    assert roles(diagnosis)["OCV test"].is_usable == is_sweep


@pytest.mark.parametrize("file", [OCV[1], OCV[3], DYNAMIC[1]])
def test_a_residual_discharge_serves_for_nothing(real_data, file):
    diagnosis = check_file(real_data / file, capacity_ah=2.06)
    assert not any(role.is_usable for role in diagnosis.roles)


@of(DYNAMIC[0])
def test_the_a123_profile_serves_to_identify(diagnosis):
    assert roles(diagnosis)["identification"].options == ("--score-steps 5",)
    assert "the profile is step 5" in roles(diagnosis)["identification"].reason


@of(*LEAVES, LEAF_CSV)
def test_the_leaf_files_are_coarse_in_reading_and_in_time(diagnosis):
    assert "voltage in steps of 1 mV, current in steps of 10 mA" in words(diagnosis, "resolution")
    assert "of 60 s under load" in words(diagnosis, "coarse intervals")


@of(*LEAVES)
def test_of_the_leaf_files_only_the_pulses_serve_to_identify(diagnosis):
    is_hppc = diagnosis.file.startswith("hppc")
    assert roles(diagnosis)["identification"].is_usable == is_hppc


@of(DST_80, DST_50)
def test_a_workbook_under_an_older_suffix_is_noted_with_its_stray_sheets(diagnosis):
    assert "an OOXML workbook, although the name ends in '.xls'" in words(diagnosis, "format")
    sheets = "Info, Sheet1, Sheet2" if "extra-sheets" in diagnosis.file else "Info"
    assert f"ignored the sheets {sheets}" in words(diagnosis, "columns")


@of(PLETT_CSV)
def test_the_plain_a123_file_has_no_units_minus_zeros_and_the_other_sign(diagnosis):
    assert "s for 'time', A for 'current', V for 'voltage'" in words(diagnosis, "columns")
    assert "written -0" in words(diagnosis, "rests")
    assert "discharge-positive" in words(diagnosis, "sign")


@of(LEAF_CSV)
def test_the_leaf_csv_has_names_twice_and_a_nameless_column(diagnosis):
    assert "3 columns are called 'Loop'" in words(diagnosis, "columns")
    assert "1 column without a name" in words(diagnosis, "columns")
