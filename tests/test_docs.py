"""The README and the pages of docs/: every block of Python runs, every command parses."""

import inspect
import pkgutil
import re
import shlex
from collections.abc import Mapping
from pathlib import Path

import pytest
from typer.main import get_command

import barnax
from barnax.cli.app import app
from barnax.optimizers import OPTIMIZERS

FOLDER = Path(__file__).parents[1] / "docs"
# Without the copies that a build of the site makes.
PAGES = {
    path.relative_to(FOLDER).as_posix(): path.read_text(encoding="utf-8")
    for path in sorted(FOLDER.rglob("*.md"))
    if path.relative_to(FOLDER).parts[0] != "repository"
}
README = (FOLDER.parent / "README.md").read_text(encoding="utf-8")
ALL_PAGES = {"../README.md": README, **PAGES}
# Each does again what another page, an example or a test does, and takes long.
SLOW = {
    *("README.md-0", "api/index.md-0", "design.md-0"),
    *("filters.md-0", "getting-started.md-0", "many-cells.md-0", "methods.md-0"),
    *("pulses.md-0", "your-own-data.md-0"),
}
BLOCKS = [
    pytest.param(block, id=each, marks=[pytest.mark.slow] if each in SLOW else [])
    for name, page in {"README.md": README, **PAGES}.items()
    for number, block in enumerate(re.findall(r"^```python\n(.*?)^```", page, re.M | re.S))
    for each in [f"{name}-{number}"]
]
# The runs and searches of the pages, as small as they can be and still do the same.
QUICK = 'model="so-rc", over="soc", max_boxes=0, resistances_follow="none", trust="none"'
SMALLER = {
    # A filter's noise is that of an assessment.
    "identify()": f"identify({QUICK}, seeds=0)".replace('st="none"', 'st="basic"'),
    'seeds=2, iterations=5, trust="none"': f"{QUICK}, seeds=0",
    "validate=barnax": f"{QUICK}, seeds=0, validate=barnax",
    "head(4000)": "head(1500)",
    "seeds=30": "seeds=2",
    "iterations=500": "iterations=5",
    "ibmo()": "ibmo(iterations=5)",
    "ibmo_centered()": "ibmo_centered(iterations=5)",
    "(0), 30)": "(0), 2)",
    "30, 100, ": "30, 5, ",
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


@pytest.fixture(scope="module")
def commands():
    return get_command(app).commands


@pytest.mark.parametrize("name", ALL_PAGES)
def test_a_page_names_only_commands_and_options_that_exist(name, commands):
    blocks = "\n".join(re.findall(r"^```sh\n(.*?)^```", ALL_PAGES[name], re.M | re.S))
    for line in re.findall(r"(?:^|&& )barnax ([^&\n]*)", blocks.replace("\\\n", " "), re.M):
        command, *words = shlex.split(line, comments=True)
        parsed = commands[command]
        # As on a command line: an option that is not there, or has no value, is refused.
        parsed.make_parser(parsed.context_class(parsed, info_name=command)).parse_args(words)
    everywhere = {
        option for command in commands.values() for p in command.params for option in spelled(p)
    }
    assert set(re.findall(r"`(--[a-z-]+)", ALL_PAGES[name])) <= everywhere


# Links of the site's pages are followed where it is built.
@pytest.mark.parametrize("name", ["../README.md", "../CONTRIBUTING.md", "paper/paper.md"])
def test_a_page_outside_the_site_links_only_to_files_that_exist(name):
    path = FOLDER / name
    links = re.findall(r"\]\((?!https?:)([^)#]+)", path.read_text(encoding="utf-8"))
    assert links
    assert all(path.parent.joinpath(link).exists() for link in links)


@pytest.mark.parametrize("name", ["../CONTRIBUTING.md", "architecture.md"])
def test_a_page_on_the_code_names_only_files_that_exist(name):
    paths = re.findall(r"`([\w/]+(?:\.(?:py|toml|txt)|/))`", (FOLDER / name).read_text("utf-8"))
    there = [
        f"{path.as_posix()}/" if path.is_dir() else path.as_posix()
        for folder in ("src", "tests", "docs", "benchmarks")
        for path in [FOLDER.parent / folder, *FOLDER.parent.joinpath(folder).rglob("*")]
    ]
    there.append(f"/{FOLDER.parent}/pyproject.toml")
    wanted = {f"/{path}" for path in paths if "NAME" not in path}
    assert len(wanted) > 20
    assert not {path for path in wanted if not any(each.endswith(path) for each in there)}


def test_the_page_on_methods_names_every_optimizer():
    assert all(f"`{name}`" in PAGES["methods.md"] for name in OPTIMIZERS)


REFERENCE = [
    f"{module}.{name}" if not name.startswith("barnax.") else name
    for page, text in PAGES.items()
    if page.startswith("api/")
    for module, names in re.findall(r"currentmodule:: (\S+)\n(.*?)(?=currentmodule|\Z)", text, re.S)
    for name in re.findall(r"^\.\. auto\w+:: (\S+)", names, re.M)
]


def described(thing):
    """The names that a docstring's section on arguments or attributes explains."""
    classes = [each for each in getattr(thing, "__mro__", (thing,)) if "barnax" in each.__module__]
    texts = [inspect.cleandoc(each.__doc__ or "") for each in classes]
    sections = re.findall(r"^(?:Args|Attributes):\n((?:    .*\n?)+)", "\n\n".join(texts), re.M)
    return {name for each in sections for name in re.findall(r"^    (\w+): ", each, re.M)}


def names_in(thing):
    """The arguments of a function, or the fields of a class."""
    if inspect.isclass(thing):
        fields = getattr(thing, "model_fields", None) or getattr(thing, "_fields", None)
        return set(fields or getattr(thing, "__dataclass_fields__", ()))
    if hasattr(thing, "__signature__"):
        return set(thing.__signature__.parameters)
    code = inspect.unwrap(thing).__code__
    has_more = bool(code.co_flags & inspect.CO_VARARGS)
    return set(code.co_varnames[: code.co_argcount + code.co_kwonlyargcount + has_more])


def test_every_public_name_is_in_the_reference():
    public = {name for name in barnax.__all__ if not inspect.ismodule(getattr(barnax, name))}
    public |= {f"plots.{name}" for name in barnax.plots.__all__}
    assert {f"barnax.{name}" for name in public} <= set(REFERENCE)


@pytest.mark.parametrize("name", REFERENCE)
def test_the_reference_explains_every_argument_and_field(name):
    thing = pkgutil.resolve_name(name)
    if not isinstance(thing, Mapping):
        assert described(thing) == names_in(thing)
