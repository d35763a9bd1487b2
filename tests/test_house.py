"""The order of the layers: a module imports only from its left (the design's one rule)."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

import barnax

PACKAGE = Path(barnax.__file__).parent
LAYERS = (
    ("errors", "metrics", "precision", "programs", "threads", "traces", "bundled", "table_layout"),
    ("records", "optimizers"),
    ("cell",),
    ("evaluator", "intervals", "simulate", "segmented", "alike", "window", "doctor"),
    ("exponentials", "bounds", "coordinates", "course", "compressed", "problem"),
    ("split_box",),
    ("identification", "descent", "refinement", "evaluate"),
    ("optimum", "trust"),
    ("methods",),
    ("result_parts", "trust_parts", "result", "result_making"),
    ("comparison",),
    ("report", "comparison_report", "trust_report", "plots", "export", "reporting"),
    ("cli",),
)
RANK = {name: rank for rank, layer in enumerate(LAYERS) for name in layer}
# What knows nothing of batteries, and what of the rest it may import.
GENERAL = {
    "optimizers": set(),
    "metrics": set(),
    "errors": set(),
    "precision": set(),
    "programs": {"traces"},
    "traces": set(),
}
# Results are the command's to write; traces go where JAX puts its own programs.
WRITERS = {"cli", "traces"}
# These say where names live and where the command starts; they are no layer.
DOORS = {"__init__", "__main__"}
MODULES = sorted(PACKAGE.rglob("*.py"))


def unit_of(path: Path) -> str:
    """The top-level module or subpackage a file belongs to."""
    return path.relative_to(PACKAGE).parts[0].removesuffix(".py")


def own_imports(path: Path) -> set[str]:
    """The top-level modules of barnax that a file imports, lazily or for types too."""
    package = ["barnax", *path.relative_to(PACKAGE).parts[:-1]]
    found = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names = [alias.name.split(".") for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            base = package[: len(package) - node.level + 1] if node.level else []
            base = [*base, *(node.module or "").split(".")] if node.module else base
            names = [[*base, alias.name] for alias in node.names]
        else:
            continue
        found |= {name[1] for name in names if name[0] == "barnax" and len(name) > 1}
    return found - {"__version__"}


def foreign_imports(path: Path) -> set[str]:
    """The distributions a file imports."""
    found = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found |= {alias.name.split(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and not node.level:
            found.add((node.module or "").split(".")[0])
    return found


def calls(path: Path) -> set[str]:
    """The names of the functions and methods a file calls."""
    nodes = (node for node in ast.walk(ast.parse(path.read_text())) if isinstance(node, ast.Call))
    return {
        node.func.id if isinstance(node.func, ast.Name) else node.func.attr
        for node in nodes
        if isinstance(node.func, ast.Name | ast.Attribute)
    }


layered = pytest.mark.parametrize(
    "path",
    [path for path in MODULES if unit_of(path) not in DOORS],
    ids=lambda path: str(path.relative_to(PACKAGE)),
)


def test_every_module_has_a_layer():
    assert {unit_of(path) for path in MODULES} - DOORS == set(RANK)


@layered
def test_a_module_imports_only_from_its_left(path):
    unit = unit_of(path)
    right = {name for name in own_imports(path) - {unit} if RANK[name] > RANK[unit]}
    assert not right


@pytest.mark.parametrize("layer", LAYERS, ids=lambda layer: layer[0])
def test_modules_of_one_layer_do_not_import_each_other_in_a_circle(layer):
    needs = {
        unit: {
            name
            for path in MODULES
            if unit_of(path) == unit
            for name in own_imports(path) & set(layer) - {unit}
        }
        for unit in layer
    }
    while ready := {unit for unit, names in needs.items() if not names & needs.keys()}:
        needs = {unit: names for unit, names in needs.items() if unit not in ready}
    assert not needs


@pytest.mark.parametrize("unit", GENERAL)
def test_what_knows_nothing_of_batteries_imports_nothing_of_them(unit):
    imported = {name for path in MODULES if unit_of(path) == unit for name in own_imports(path)}
    assert imported <= {unit} | GENERAL[unit]


@layered
def test_only_the_command_line_imports_typer_and_prints(path):
    if unit_of(path) != "cli":
        assert "typer" not in foreign_imports(path)
        assert "print" not in calls(path)


@layered
def test_only_writers_write_files(path):
    if unit_of(path) not in WRITERS:
        assert not calls(path) & {"write_text", "write_bytes", "mkdir", "savefig", "unlink"}


@layered
def test_only_plots_draw(path):
    if unit_of(path) not in ("plots", "cli"):
        assert "matplotlib" not in foreign_imports(path)


@layered
def test_no_numeric_module_flips_a_global_of_jax(path):
    # The command line may set up its own process; an import or a function may not.
    if unit_of(path) != "cli":
        assert "jax.config.update" not in path.read_text(encoding="utf-8")


def test_importing_barnax_loads_no_jax():
    script = "import sys, barnax; print(sorted({'jax', 'numpy', 'matplotlib'} & set(sys.modules)))"
    ran = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert ran.stdout.strip() == "[]"
