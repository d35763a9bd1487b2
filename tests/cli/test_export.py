"""`barnax export`: one file, whole or not at all, and what it leaves out on stderr."""

import hashlib
import importlib.util
import json
import os
import re
import shutil
from pathlib import Path

import pytest

from barnax.cli.output import LIST
from barnax.export import EXPORTERS
from barnax.results import Result
from helpers.golden import RESULT

from .conftest import contents


@pytest.fixture
def stored(tmp_path):
    folder = tmp_path / "results"
    folder.mkdir()
    return Path(shutil.copy(RESULT, folder))


@pytest.mark.parametrize("name", EXPORTERS)
def test_every_target_goes_to_its_file(run, stored, tmp_path, name):
    outcome = run("export", stored, "--to", name)
    exporter = EXPORTERS[name]
    content, caveats = exporter.write(Result.from_json(stored))
    assert outcome.status == 0
    assert exporter.file_name in outcome.out.replace("\n", "")
    assert outcome.err == "".join(f"warning: {caveat}\n" for caveat in caveats)
    # Beside the result, so that exports of two results are two files.
    assert stored.with_name(exporter.file_name).read_bytes() == content
    assert {*contents(stored.parent)} == {exporter.file_name, "result.json"}


def test_an_export_in_a_folder_of_results_is_one_of_its_files(run, stored):
    # So that another result, which takes the folder's place, leaves none of this cell's.
    hashes = {stored.name: hashlib.sha256(stored.read_bytes()).hexdigest()}
    stored.with_name(LIST).write_text(json.dumps(hashes), encoding="utf-8")
    run("export", stored, "--to", "csv")
    path = stored.with_name(EXPORTERS["csv"].file_name)
    listed = json.loads(stored.with_name(LIST).read_text())
    assert listed == hashes | {path.name: hashlib.sha256(path.read_bytes()).hexdigest()}


@pytest.mark.parametrize("name", ["pybamm", "thevenin"])
# What other packages warn of when they are imported is theirs.
@pytest.mark.filterwarnings("ignore")
def test_verify_prints_the_largest_difference_in_volts(run, stored, name):
    if importlib.util.find_spec(name) is None:
        pytest.skip(f"{name} is not installed; it is in the extra verify")
    outcome = run("export", stored, "--to", name, "--verify")
    assert outcome.status == 0
    words = " ".join(outcome.out.split())
    assert f"Largest difference from barnax in {name} " in words
    assert re.search(r"pulse test: [0-9.e-]+ V \(RMS [0-9.e-]+ V\)", words)


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="this system has no pipes with names")
@pytest.mark.parametrize("target", ["pipe", "/dev/null"])
def test_a_device_is_never_replaced(refuse, stored, tmp_path, target):
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "link").symlink_to(target)
    for out in (target, "link"):
        message = refuse("export", stored, "--to", "csv", "--out", out, "--force")
        assert "is a device or a pipe, and no file; give --out another file" in message
