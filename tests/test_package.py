"""The package as a user meets it: a light import, true metadata, a README that runs."""

import doctest
import importlib
import importlib.metadata
import inspect
import json
import re
import subprocess
import sys
import tarfile
import tomllib
import zipfile
from pathlib import Path

import pytest

import barnax
from barnax.bundled import BUNDLED_NAMES, HPPC_NAMES, LFP_NAMES
from barnax.select.choose import Tried
from helpers.golden import RESULT

REPOSITORY = Path(__file__).parents[1]
SOURCE = REPOSITORY / "src"
HEAVY = {"jax", "jaxlib", "matplotlib", "polars", "scipy", "equinox", "optimistix"}


def python(*words: str) -> str:
    """What a fresh interpreter prints; its failure is the test's."""
    done = subprocess.run(
        [sys.executable, *words], capture_output=True, text=True, check=True, timeout=120
    )
    return done.stdout


def loaded_by(code: str) -> set[str]:
    """The top-level modules that are loaded after some code ran."""
    report = "import json, sys; print(json.dumps([name.split('.')[0] for name in sys.modules]))"
    return set(json.loads(python("-c", f"{code}\n{report}").splitlines()[-1]))


def loaded_by_commands(*commands: list[str]) -> set[str]:
    """What one process has loaded after commands that end well."""
    return loaded_by(
        "import sys; from barnax.__main__ import main\n"
        f"for words in {commands}:\n"
        "    sys.argv = ['barnax', *words]\n"
        "    try: main()\n"
        "    except SystemExit as end: assert not end.code, end.code"
    )


def test_importing_barnax_loads_nothing_heavy():
    assert not loaded_by("import barnax, barnax.__main__; barnax.__version__; dir(barnax)") & HEAVY
    assert not loaded_by_commands(["--help"], ["identify", "--help"]) & HEAVY
    screen = loaded_by("from barnax.reporting import first_screen; first_screen.first_screen")
    assert screen & {"numpy", "matplotlib"} == {"numpy"}


def test_a_file_is_checked_and_converted_without_jax_and_figures(tmp_path):
    name, out = str(barnax.bundled_file("ocv_charge")), str(tmp_path / "converted.csv")
    loaded = loaded_by_commands(["check", name], ["convert", name, "--out", out])
    assert "polars" in loaded
    assert not loaded & {"jax", "equinox", "optimistix", "matplotlib"}


def test_a_result_is_shown_without_jax_in_every_form(tmp_path):
    result = barnax.Result.from_json(RESULT)
    tried = Tried(None, result.model, 1, (), 0.01, None, None)
    fresh, aged = (str(tmp_path / name) for name in ("fresh.json", "aged.json"))
    for path in (fresh, aged):
        text = result.model_copy(update={"tried": (tried,)}).to_json()
        Path(path).write_text(text, encoding="utf-8")
    forms = [fresh], [fresh, "--all"], [fresh, aged], [fresh, "--choice"]
    loaded = loaded_by_commands(*(["show", *form] for form in forms))
    assert "pydantic" in loaded
    assert not loaded & {"jax", "jaxlib", "equinox", "optimistix"}


def test_the_version_is_one_everywhere():
    assert python("-m", "barnax", "--version") == f"barnax {barnax.__version__}\n"
    assert barnax.__version__ == importlib.metadata.version("barnax")
    citation = (REPOSITORY / "CITATION.cff").read_text(encoding="utf-8")
    assert re.search(r"^version: (.*)$", citation, re.M)[1] == barnax.__version__


@pytest.fixture(scope="module")
def everything():
    """What one fresh interpreter reports that imports every name, in random order."""
    code = """
import json, random
import jax
before = dict(jax.config.values)
import barnax
names = random.Random(0).sample(barnax.__all__, len(barnax.__all__))
report = {"kinds": {name: type(getattr(barnax, name)).__name__ for name in names}}
report["changed"] = [key for key, value in jax.config.values.items() if before.get(key) != value]
from jax._src import xla_bridge
report["has devices"] = xla_bridge.backends_are_initialized()
print(json.dumps(report))
"""
    return json.loads(python("-c", code))


def test_all_names_resolve_to_the_same_kinds_in_any_order(everything):
    # In this process they are loaded in the order in which tests need them.
    first = {name: type(getattr(barnax, name)).__name__ for name in barnax.__all__}
    assert everything["kinds"] == first
    assert set(first) == set(barnax.__all__) == set(dir(barnax))
    # Importing everything changes no setting of JAX and starts no device.
    assert (everything["changed"], everything["has devices"]) == ([], False)
    with pytest.raises(AttributeError, match="No barnax attribute barnacle_goose"):
        _ = barnax.barnacle_goose


def test_every_public_name_has_a_docstring():
    values = {name: getattr(barnax, name) for name in barnax.__all__}
    # A registry and the version have no docstring of their own.
    named = {
        name: each for name, each in values.items() if callable(each) or inspect.ismodule(each)
    }
    assert not [name for name, each in named.items() if not inspect.getdoc(each)]
    for name in ("identify", "compare", "check_file", "read_record", "Result", "bundled_file"):
        assert ">>> " in inspect.getsource(inspect.unwrap(named[name]))


WITH_EXAMPLES = [
    ".".join(path.relative_to(SOURCE).with_suffix("").parts).removesuffix(".__init__")
    for path in sorted(SOURCE.rglob("*.py"))
    if ">>> " in path.read_text()
]


# These take seconds, and have tests elsewhere.
LONG = ("barnax.experiment.next_test", "barnax.pack", "barnax.results")


@pytest.mark.parametrize(
    "name",
    [
        pytest.param(each, marks=[pytest.mark.slow] if each in LONG else [])
        for each in WITH_EXAMPLES
    ],
)
def test_the_examples_of_docstrings_run(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    module, finder = importlib.import_module(name), doctest.DocTestFinder()
    # A function under `jit` is not a function to doctest.
    values = [inspect.unwrap(each) for each in vars(module).values() if callable(each)]
    functions = [each for each in values if getattr(each, "__module__", None) == name]
    doctests = doctest.DocTestFinder(recurse=False).find(module)
    doctests += [one for each in functions for one in finder.find(each, each.__name__, module)]
    runner = doctest.DocTestRunner(optionflags=doctest.ELLIPSIS)
    assert sum(runner.run(each).attempted for each in doctests if each.examples) > 0
    assert runner.failures == 0


def build(folder):
    for name in ("hatchling", "hatch_fancy_pypi_readme"):
        pytest.importorskip(name, reason=f"a wheel is built without isolation: needs {name}")
    words = [sys.executable, "-m", "hatchling", "build", "-d", str(folder)]
    subprocess.run(words, cwd=REPOSITORY, check=True, capture_output=True, timeout=120)


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    """A folder with the wheel and the sdist."""
    folder = tmp_path_factory.mktemp("dist")
    build(folder)
    return folder


def files_below(folder):
    files = (path for path in folder.rglob("*") if path.is_file() and path.suffix != ".pyc")
    return {path.relative_to(folder.parent).as_posix() for path in files}


def test_a_wheel_is_the_package_with_its_bundled_cells_and_licences(built):
    (wheel,) = built.glob("*.whl")
    names = zipfile.ZipFile(wheel).namelist()
    data = {f"barnax/{name}" for name in files_below(REPOSITORY / "data")}
    assert {n for n in names if ".dist-info/" not in n} == files_below(SOURCE / "barnax") | data
    shipped = [*BUNDLED_NAMES, *HPPC_NAMES, *LFP_NAMES]
    assert {f"barnax/data/virtual_cell/{name}.parquet" for name in shipped} <= data
    assert {name.rpartition("/")[2] for name in names if "licenses/" in name} == {
        *("LICENSE", "uPlot.LICENSE")
    }


def test_the_page_of_an_index_has_no_link_that_leads_nowhere_there(built):
    (wheel,) = built.glob("*.whl")
    (name,) = (n for n in zipfile.ZipFile(wheel).namelist() if n.endswith("/METADATA"))
    page = zipfile.ZipFile(wheel).read(name).decode()
    assert "# barnax" in page
    assert not re.findall(r"\]\((?!https?:).*?\)", page)


def test_an_sdist_has_what_builds_and_tests_it(built):
    (sdist,) = built.glob("*.tar.gz")
    with tarfile.open(sdist) as archive:
        names = {name.partition("/")[2] for name in archive.getnames()}
    for folder in ("src/barnax", "data/virtual_cell", "tests", "benchmarks", "conda"):
        assert {
            f"{Path(folder).parent / each}" for each in files_below(REPOSITORY / folder)
        } <= names
    assert {"pyproject.toml", "README.md", "LICENSE", "CITATION.cff"} <= names
    assert not any(name.startswith("docs/repository") for name in names)


def test_the_conda_recipe_needs_what_the_package_needs():
    project = tomllib.loads((REPOSITORY / "pyproject.toml").read_text())["project"]
    recipe = (REPOSITORY / "conda" / "recipe.yaml").read_text()
    run = re.search(r"^  run:\n((?:    - .*\n)+)", recipe, re.M)[1]
    # On conda-forge, matplotlib without a window system has another name.
    listed = run.replace(" ", "").replace("matplotlib-base", "matplotlib").split("\n-")
    needed = {f"python{project['requires-python']}", *project["dependencies"]}
    assert {each.strip("-\n") for each in listed} == needed
    assert f'version: "{barnax.__version__}"' in recipe
    hosts = tomllib.loads((REPOSITORY / "pyproject.toml").read_text())["build-system"]["requires"]
    assert all(f"    - {host.replace('>=', ' >=')}\n" in recipe for host in hosts)
