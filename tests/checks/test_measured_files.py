"""What the README of the measured cells says of each file is found, and no more counts.

All findings and roles stand in `measured.txt`, written anew with BARNAX_WRITE_GOLDEN=1.
"""

from pathlib import Path

from barnax.checks import check_file
from helpers.golden import require_golden
from records.test_measured_records import FILES, RAW


def test_every_finding_and_role_is_worded_as_it_was_written_down(real_data):
    lines = []
    for file in (*FILES, *(f"raw/{name}" for name in RAW)):
        outcome = check_file(real_data / file)
        lines.append(f"{file}: {outcome.traits.kind(None)}")
        lines += [f"  {each.severity} {each.check}: {each}" for each in outcome.findings]
        for role in outcome.roles:
            options = f" {role.window.options}" if role.window else ""
            options += " initial_soc" if role.window and role.window.needs_initial_soc else ""
            verdict = "yes" if role.is_usable else "no"
            lines.append(f"  {role.name}: {verdict}, {role.reason}{options}")
    require_golden(Path(__file__).with_name("measured.txt"), "\n".join(lines) + "\n")
