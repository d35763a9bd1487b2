"""What the README of the measured cells says of each file is found, and no more counts.

All findings and roles stand in `measured.txt`, written anew with BARNAX_WRITE_GOLDEN=1.
"""

from pathlib import Path

import pytest

from barnax.checks import check_file
from helpers.golden import require_golden

CALCE, PLETT, LEAF = "calce-inr18650-20r", "plett-a123-26650", "nissan-leaf-lmo-33ah"
DRIVES = [
    f"{CALCE}/{profile}_{degc}degC_{soc}soc_SP20-2.parquet"
    for profile in ("dst", "us06")
    for degc, soc in ((25, 80), (25, 50), (0, 80), (45, 80))
]


LOW_CURRENT = f"{CALCE}/ocv-low-current_25degC_SP20-1.parquet"
INCREMENTAL = f"{CALCE}/ocv-incremental_25degC_SP20-3.parquet"
PART3 = f"{CALCE}/ocv-incremental-part3_25degC_SP20-1.parquet"
DYNAMIC = [f"{PLETT}/dyn-s{number}_25degC.parquet" for number in (1, 2, 3)]
OCV = [f"{PLETT}/ocv-s{number}_25degC.parquet" for number in (1, 2, 3, 4)]
LEAVES = [f"{LEAF}/{name}.parquet" for name in ("hppc_25degC", "discharge-1c", "discharge-3c")]
RAW_DRIVES = [
    "raw/11_05_2015_SP20-2_DST_80SOC.xls",
    "raw/11_05_2015_SP20-2_DST_50SOC.with-extra-sheets.xls",
]
RAW = [
    *RAW_DRIVES,
    "raw/12_2_2015_Incremental OCV test_SP20-13.csv",
    "raw/A123_DYN_50_P25_s2.csv",
    "raw/leaf-cell-discharge-bitrode-1c.csv",
]
FILES = [*DRIVES, LOW_CURRENT, INCREMENTAL, PART3, *DYNAMIC, *OCV, *LEAVES, *RAW]


@pytest.fixture(scope="module")
def checks(real_data):
    return {file: check_file(real_data / file) for file in FILES}


def test_every_finding_and_role_is_worded_as_it_was_written_down(checks):
    lines = []
    for file, outcome in checks.items():
        lines.append(f"{file}: {outcome.traits.kind(None)}")
        lines += [f"  {each.severity} {each.check}: {each}" for each in outcome.findings]
        for role in outcome.roles:
            options = f" {role.window.options}" if role.window else ""
            options += " initial_soc" if role.window and role.window.needs_initial_soc else ""
            verdict = "yes" if role.is_usable else "no"
            lines.append(f"  {role.name}: {verdict}, {role.reason}{options}")
    require_golden(Path(__file__).with_name("measured.txt"), "\n".join(lines) + "\n")
