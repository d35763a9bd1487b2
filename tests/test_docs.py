"""The pages of docs/: every block of Python runs, every command and link exists."""

import re
import subprocess
import sys
from pathlib import Path

import pytest
from typer.main import get_command

from barnax.cli.app import app
from barnax.optimizers import OPTIMIZERS

FOLDER = Path(__file__).parents[1] / "docs"
PAGES = {path.name: path.read_text(encoding="utf-8") for path in sorted(FOLDER.glob("*.md"))}
# A joint fit of pulse tests, a replay, and the run that CI makes anyway from the command line.
SLOW = {"pulses.md-0", "filters.md-0", "getting-started.md-0"}
BLOCKS = [
    pytest.param(block, id=each, marks=[pytest.mark.slow] if each in SLOW else [])
    for name, page in PAGES.items()
    for number, block in enumerate(re.findall(r"^```python\n(.*?)^```", page, re.M | re.S))
    for each in [f"{name}-{number}"]
]
# The searches of the pages, as small as they can be and still run.
SMALLER = {
    "seeds=30": "seeds=2",
    "iterations=500": "iterations=5",
    "RandomWalk()": "RandomWalk(iterations=20)",
}


@pytest.mark.parametrize("block", BLOCKS)
def test_a_python_block_runs(block, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for spoken, small in SMALLER.items():
        block = block.replace(spoken, small)
    exec(compile(block, "docs", "exec"), {"__name__": "docs"})


def spelled(parameter):
    """How an option can be written, to switch on and off."""
    return [*parameter.opts, *parameter.secondary_opts]


@pytest.mark.parametrize("name", PAGES)
def test_a_page_names_only_commands_and_options_that_exist(name):
    commands = get_command(app).commands
    blocks = "\n".join(re.findall(r"^```sh\n(.*?)^```", PAGES[name], re.M | re.S))
    for command, words in re.findall(r"^barnax (\w+) ?((?:.*\\\n)*.*)$", blocks, re.M):
        options = {option for each in commands[command].params for option in spelled(each)}
        assert set(re.findall(r"(?<!\S)--[a-z-]+", words)) <= options
    everywhere = {
        option for command in commands.values() for p in command.params for option in spelled(p)
    }
    assert set(re.findall(r"`(--[a-z-]+)", PAGES[name])) <= everywhere


@pytest.mark.parametrize("name", PAGES)
def test_a_page_links_only_to_files_that_exist(name):
    links = re.findall(r"\]\((?!https?:)([^)#]+)\)", PAGES[name])
    assert all((FOLDER / link).exists() for link in links)
    paths = re.findall(r"`(src/[\w/.]+)`", PAGES[name])
    assert all((FOLDER.parent / path).exists() for path in paths)


def test_the_page_on_methods_names_every_optimizer():
    assert all(f"`{name}`" in PAGES["methods.md"] for name in OPTIMIZERS)


def test_every_page_is_in_the_table_of_contents():
    listed = PAGES["index.md"].splitlines()
    written = [*FOLDER.glob("*.md"), *FOLDER.glob("notebooks/*.md")]
    names = {path.relative_to(FOLDER).with_suffix("").as_posix() for path in written} - {"index"}
    assert names <= set(listed)


@pytest.mark.slow
def test_the_site_builds_without_a_warning(tmp_path):
    pytest.importorskip("sphinx", reason="the site needs the extra docs")
    done = subprocess.run(
        [sys.executable, "-m", "sphinx", "-q", "-W", "--keep-going", str(FOLDER), str(tmp_path)],
        capture_output=True,
        text=True,
        timeout=900,
    )
    assert done.returncode == 0, done.stderr[-3000:]
