"""`barnax soc`: a stored circuit on a record, its screen and its files."""

import json

from barnax.bundled import BUNDLED
from barnax.replay import SCENARIOS

from .conftest import contents


def test_a_replay_is_a_screen_a_file_and_a_figure(run, finished, tmp_path):
    outcome = run(
        "soc", finished.folder, BUNDLED.validation, "--filter", "ukf", "--estimate", "", "--paper"
    )
    assert outcome.status == 0, outcome.err
    lines = outcome.out.splitlines()
    assert len(lines) <= 17
    assert max(map(len, lines)) <= 80
    # The window ends at 87 % SOC, which leaves no room for a start 20 % too high.
    tried = [each.name for each in SCENARIOS if each.soc_error <= 0]
    assert all(any(line.strip().startswith(name) for line in lines) for name in tried)
    assert any(line.startswith("  Not tried:      start 20 % too high") for line in lines)
    files = {"soc.json", "figures/soc.png", "timings.json", "files.json"}
    files |= {f"figures/paper/soc.{kind}" for kind in ("pdf", "svg")}
    assert {f"barnax-soc/{each}" for each in files} <= set(contents(tmp_path))
    stored = json.loads((tmp_path / "barnax-soc/soc.json").read_text())
    assert stored["settings"]["kind"] == "ukf"
    assert [each["name"] for each in stored["scenarios"]] == tried
    # Errors of the whole record stand before those from convergence on.
    for part in stored["scenarios"]:
        (row,) = (line for line in lines if line.strip().startswith(part["name"] + "  "))
        shown = row.removeprefix("  " + part["name"]).split()[:2]
        assert shown == [f"{100 * part[name]:.1f}" for name in ("whole_rms", "whole_max")]
    again = run("soc", finished.folder, BUNDLED.validation)
    assert "holds a result; replace it with --force" in again.err
