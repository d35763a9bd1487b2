"""The house: what may import what, who prints and who touches files, how large a file is."""

import ast
import importlib.metadata
import re
import subprocess
import sys
import tomllib
from functools import cache
from graphlib import TopologicalSorter
from pathlib import Path

import pytest

import barnax
from barnax.display import HOOKS, hook

PACKAGE = Path(barnax.__file__).parent
PROJECT = tomllib.loads((Path(__file__).parents[1] / "pyproject.toml").read_text(encoding="utf-8"))
# A module imports only from those left of its own, for types or when it is called too: the order in
# which a record becomes a report.
LAYERS = (
    ("blas", "devices", "programs"),
    ("display", "errors", "metrics", "execution"),
    ("notices", "files", "settings"),
    ("schema", "bundled", "records", "optimizers"),
    ("cell",),
    ("checks", "model"),
    ("search", "pulses", "filters"),
    ("global_optimum",),
    ("uncertainty", "baselines"),
    ("fit",),
    ("select", "bounds_file"),
    ("job",),
    ("inputs", "result_parts"),
    ("results", "plan"),
    ("simulation", "result_filter", "scenarios"),
    ("reopening", "replay", "experiment"),
    ("export", "life"),
    ("identification",),
    ("comparison", "plots"),
    ("pack",),
    ("fleet",),
    ("reporting",),
    ("cli",),
)
RANK = {name: rank for rank, layer in enumerate(LAYERS) for name in layer}
# What knows nothing of batteries, and what of the rest it may import.
GENERAL = {
    "optimizers": {"errors"},
    "metrics": set(),
    "errors": set(),
    "display": set(),
    "execution": {"blas", "programs"},
    "programs": set(),
    "blas": set(),
    "devices": set(),
}
# Where what users give is read, beside the command line.
READING = {"records/source.py", "schema.py", "plan/document.py"}
# Files within a file in memory.
READING |= {"records/readers/content.py"}
# The source that a program is made from, the processor, and what is kept.
READING |= {"programs.py"}
# The words of all that is told.
READING |= {"notices.py"}
# Where files are put in place whole.
WRITING = "files.py"
# A fleet's workers write their rows themselves, wherever they run; its manifest is read there too.
DATASET = "fleet/dataset.py"
READING |= {WRITING, DATASET, "fleet/manifest.py"}
# What imports by name.
BY_NAME = {"import_module", "resolve_name", "__import__"}
# The worker hands these flags to XLA.
FLAGS_OF_OTHERS = {"fleet/engine.py"}
# These say where names live and where the command starts; they are no layer.
DOORS = {"__init__", "__main__"}
SHORTEST, LONGEST = 20, 400
MODULES = sorted(PACKAGE.rglob("*.py"))


def unit_of(path: Path) -> str:
    """The top-level module or subpackage a file belongs to."""
    return path.relative_to(PACKAGE).parts[0].removesuffix(".py")


@cache
def nodes_of(path: Path) -> list[ast.AST]:
    """All nodes of a file, the module first."""
    return [*ast.walk(ast.parse(path.read_text(encoding="utf-8")))]


def module_name(path: Path) -> str:
    return ".".join(path.relative_to(PACKAGE.parent).with_suffix("").parts)


def is_for_types(node: ast.AST) -> bool:
    return isinstance(node, ast.If) and getattr(node.test, "id", None) == "TYPE_CHECKING"


@cache
def imports_of(path: Path, *, is_run: bool = False) -> set[str]:
    """What a file imports, by full name: for types and in functions too, or only what `is_run`."""
    package = module_name(path).split(".")[:-1]
    collected: set[str] = set()
    waiting = [nodes_of(path)[0]]
    while waiting:
        node = waiting.pop()
        if isinstance(node, ast.Import):
            collected |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            base = package[: len(package) - node.level + 1] if node.level else []
            base = base + (node.module.split(".") if node.module else [])
            collected |= {".".join([*base, alias.name]) for alias in node.names}
        elif not (is_run and is_for_types(node)):
            waiting += ast.iter_child_nodes(node)
    return collected


def units_imported(path: Path) -> set[str]:
    """The top-level modules of barnax that a file imports."""
    names = [name.split(".") for name in imports_of(path)]
    actual = {name[1] for name in names if name[0] == "barnax" and len(name) > 1}
    return actual - {"__version__", unit_of(path)}


def foreign_imports(path: Path) -> set[str]:
    """The distributions a file imports when it runs."""
    return {name.split(".")[0] for name in imports_of(path, is_run=True)}


@cache
def calls(path: Path) -> set[str]:
    """The names of the functions and methods a file calls."""
    nodes = (node for node in nodes_of(path) if isinstance(node, ast.Call))
    return {
        node.func.id if isinstance(node.func, ast.Name) else node.func.attr
        for node in nodes
        if isinstance(node.func, ast.Name | ast.Attribute)
    }


def texts_in(path: Path) -> list[str]:
    """Every literal text of a file but its docstrings."""
    documented = (ast.Module, ast.ClassDef, ast.FunctionDef)
    docstrings = {
        id(node.body[0].value)
        for node in nodes_of(path)
        if isinstance(node, documented) and node.body and isinstance(node.body[0], ast.Expr)
    }
    return [
        node.value
        for node in nodes_of(path)
        if isinstance(node, ast.Constant)
        and isinstance(node.value, str)
        and id(node) not in docstrings
    ]


def label(path: Path) -> str:
    return path.relative_to(PACKAGE).as_posix()


def outside(*units: str) -> list[Path]:
    """The files of all units but these."""
    return [path for path in MODULES if unit_of(path) not in {*DOORS, *units}]


def test_every_module_has_a_layer():
    assert {unit_of(path) for path in MODULES} - DOORS == set(RANK)


def test_the_page_on_architecture_has_the_layers():
    page = Path(__file__).parents[1] / "docs" / "architecture.md"
    rows = re.findall(r"^\| (\d*) ?\| `([\w/.]+)` \|", page.read_text(encoding="utf-8"), re.M)
    layers: list[list[str]] = []
    for number, name in rows:
        if number:
            layers.append([])
            assert len(layers) == int(number)
        layers[-1].append(name.removesuffix("/").removesuffix(".py"))
    assert layers == [[*layer] for layer in LAYERS]


def test_a_module_imports_only_from_its_left():
    pairs = {(unit_of(path), name) for path in outside() for name in units_imported(path)}
    assert not {(unit, name) for unit, name in pairs if RANK[name] >= RANK[unit]}


def distribution(name: str) -> str:
    """The name of a requirement, in its normal form."""
    return re.split(r"[\s<>=!~;\[]", name)[0].replace("_", "-").lower()


def test_what_the_source_imports_is_declared_and_what_is_declared_is_imported():
    providers = importlib.metadata.packages_distributions()
    imported = {name.split(".")[0] for path in MODULES for name in imports_of(path)}
    # What the extras bring is loaded only where it is needed.
    optional = {"access_parser", "dask", "distributed", "galvani", "h5py", "upath"}
    foreign = imported - sys.stdlib_module_names - optional - {"barnax"}
    needed = {distribution(providers[name][0]) for name in foreign}
    declared = {distribution(each) for each in PROJECT["project"]["dependencies"]}
    # What pydantic, jinja2 and JAX bring along.
    assert needed - {"pydantic-core", "markupsafe", "jaxlib"} == declared


def explained_in(docstring: str) -> set[str]:
    """The names in a docstring's sections on arguments and attributes."""
    sections = re.findall(r"^(?:Args|Attributes):\n((?:    .*\n?)+)", docstring, re.M)
    return {name for each in sections for name in re.findall(r"^    (\w+): ", each, re.M)}


def parameters_of(node: ast.FunctionDef | ast.ClassDef) -> set[str]:
    """The arguments of a function; the fields of a class, and what its methods set."""
    of_self = (each for each in ast.walk(node) if isinstance(each, ast.Attribute | ast.AnnAssign))
    names = {ast.unparse(getattr(each, "target", each)).removeprefix("self.") for each in of_self}
    return names | {each.arg for each in ast.walk(node) if isinstance(each, ast.arg)}


def test_a_docstring_explains_only_arguments_and_fields_that_exist():
    unknown, seen = [], 0
    for path in MODULES:
        for node in nodes_of(path):
            if isinstance(node, ast.FunctionDef | ast.ClassDef):
                explained = explained_in(ast.get_docstring(node) or "")
                # A run's options are in the signature of its job, which the reference's test reads.
                if "takes_options" not in "".join(map(ast.unparse, node.decorator_list)):
                    seen += len(explained)
                    names = sorted(explained - parameters_of(node))
                    unknown += [f"{label(path)}: {node.name}: {name}" for name in names]
    assert seen > 500
    assert unknown == []


def test_no_modules_import_each_other_in_a_circle():
    files = {module_name(path).removesuffix(".__init__"): path for path in MODULES}

    def module_of(name):
        # `from .registry import make` names something in a module.
        return name if name in files else name.rpartition(".")[0]

    needs = {
        name: {module_of(imported) for imported in imports_of(path)} & (files.keys() - {name})
        for name, path in files.items()
    }
    assert len(list(TopologicalSorter(needs).static_order())) == len(files)


def test_every_hook_has_its_function_and_every_call_its_hook():
    called = {
        ast.literal_eval(node.args[0])
        for path in MODULES
        for node in nodes_of(path)
        if isinstance(node, ast.Call) and getattr(node.func, "id", None) == "hook"
    }
    assert called == set(HOOKS)
    assert all(callable(hook(method)) for method in called)
    # No other import hides in a text; those of packages that are exported for are no module's.
    by_name = {label(path) for path in outside("cli") if calls(path) & BY_NAME}
    assert by_name == {"display.py", "export/python_modules.py"}


@pytest.mark.parametrize("unit", GENERAL)
def test_what_knows_nothing_of_batteries_imports_nothing_of_them(unit):
    imported = {name for path in MODULES if unit_of(path) == unit for name in units_imported(path)}
    assert imported <= GENERAL[unit]


def test_only_the_command_line_imports_typer_and_prints():
    paths = outside("cli")
    assert not [label(path) for path in paths if "typer" in foreign_imports(path)]
    assert not [label(path) for path in paths if "print" in calls(path)]


def test_only_the_command_line_names_its_flags():
    flags = [(label(path), text) for path in outside("cli") for text in texts_in(path)]
    named = {path for path, text in flags if re.search("(?<!-)--[a-z]", text)}
    assert named == FLAGS_OF_OTHERS


def test_only_the_command_line_writes_files():
    written = {"write_text", "write_bytes", "mkdir", "savefig", "unlink"}
    writing = [label(path) for path in outside("cli") if calls(path) & written]
    # Programs are written for this user alone.
    assert writing == [WRITING, DATASET, "programs.py"]


def test_few_files_read_files():
    read = {"read_text", "read_bytes", "open"}
    assert {label(path) for path in outside("cli") if calls(path) & read} == READING


def test_only_plots_draw():
    drawing = [path for path in outside("cli") if "matplotlib" in foreign_imports(path)]
    assert {unit_of(path) for path in drawing} == {"plots"}


def test_no_numeric_module_flips_a_global_of_jax():
    # The command line may set up its own process; an import or a function may not.
    texts = {label(path): path.read_text(encoding="utf-8") for path in outside("cli")}
    assert not [path for path, text in texts.items() if "jax.config.update" in text]


def test_a_file_is_about_one_thing_and_more_than_a_function_without_a_home():
    lines = {label(path): path.read_text(encoding="utf-8").count("\n") for path in MODULES}
    assert {path: count for path, count in lines.items() if count > LONGEST} == {}
    short = {path for path, count in lines.items() if count < SHORTEST}
    assert not {path for path in short if not path.endswith("__init__.py")}


def test_checks_and_fleets_reports_load_neither_jax_nor_matplotlib_nor_what_scipy_has_of_signals():
    """They take longer to load than a check itself."""
    modules = "barnax.checks, barnax.reporting.fleet, barnax.reporting.wording"
    modules += ", barnax.reporting.terminal"
    heavy = "{'jax', 'matplotlib', 'scipy.signal', 'scipy.stats'} & set(sys.modules)"
    script = f"import sys, {modules}; print(sorted({heavy}))"
    ran = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert ran.stdout.strip() == "[]"
