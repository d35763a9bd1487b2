"""The site: `python -m sphinx -W docs build/site` after `pip install -e ".[docs]"`."""

import re
import shutil
import sys
from pathlib import Path
from typing import Any

from docutils.nodes import SkipNode, literal
from docutils.utils.math.latex2mathml import tex2mathml

import barnax

HERE = Path(__file__).parent
LONGEST_UNBROKEN = 26
sys.path.insert(0, str(HERE))
from signatures import add_types, show_call  # noqa: E402

REPOSITORY = HERE.parent

project = "barnax"
author = "The barnax developers"
copyright = "The barnax developers, BSD-3-Clause"
release = version = barnax.__version__

extensions = [
    "myst_nb",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "sphinx_copybutton",
    "sphinx_design",
]
exclude_patterns = ["build", "paper/*", "result.schema.json"]
html_theme = "furo"
html_title = f"barnax {release}"
html_static_path = ["site.css", "sort.js"]
html_css_files = ["site.css"]
html_js_files = ["sort.js"]
html_show_sphinx = False
html_favicon = "icon.svg"

myst_enable_extensions = ["colon_fence", "deflist", "dollarmath"]
# Equations are MathML, which browsers draw themselves: nothing is loaded, and it works offline.
html_math_renderer = "mathml"
myst_heading_anchors = 3
# Notebooks run from their text, each in a folder of its own, and a failing cell fails the site.
nb_execution_mode = "cache"
nb_execution_cache_path = str(REPOSITORY / "build" / "notebooks")
nb_execution_timeout = 900
nb_execution_in_temp = True
nb_execution_raise_on_error = True
nb_merge_streams = True
# Without execution no kernel says what language a cell is in.
suppress_warnings = ["myst-nb.lexer"]

autodoc_member_order = "bysource"
# Types stand with the descriptions, as the source writes them.
autodoc_typehints = "none"
napoleon_use_ivar = True
napoleon_attr_annotations = False
python_maximum_signature_line_length = 88

# Pages that stand elsewhere in the repository, where its own readers look for them, are copied into
# a folder that git ignores; links to them lead to the copies.
COPIES = HERE / "repository"
RESULTS = REPOSITORY / "benchmarks" / "results"
TAKEN = {
    "../CONTRIBUTING.md": "contributing.md",
    "../CHANGELOG.md": "changelog.md",
    "../data/virtual_cell/README.md": "data.md",
    "../benchmarks/results/": "results/",
}


def copy_pages(app: Any) -> None:
    """Copy the pages and the pictures of the results."""
    pages = {COPIES / inside: HERE / outside for outside, inside in TAKEN.items()}
    del pages[COPIES / "results"]
    results = sorted(set(RESULTS.glob("*.md")) - {RESULTS / "README.md"})
    pages |= {COPIES / "results" / path.name: path for path in (RESULTS / "README.md", *results)}
    listed = "\n".join(path.stem for path in results)
    for copy, path in pages.items():
        up = "../" * (len(copy.relative_to(HERE).parts) - 1)
        text = path.read_text(encoding="utf-8")
        moved = {"docs/": up, "../../docs/": up, "CHANGELOG.md": "changelog.md"}
        for there, here in (moved | {"benchmarks/results/": "results/"}).items():
            text = text.replace(f"]({there}", f"]({here}")
        if copy == COPIES / "results" / "README.md":
            text += f"\n```{{toctree}}\n:hidden:\n\n{listed}\n```\n"
        # A search finds the guides, not what they rest on.
        _write(copy, text if copy.name == "data.md" else f"---\nnosearch: true\n---\n\n{text}")
    for path in RESULTS.glob("*.png"):
        shutil.copy2(path, COPIES / "results" / path.name)


def _write(path: Path, text: str) -> None:
    """Write only what differs, so that an unchanged page is not built again."""
    path.parent.mkdir(parents=True, exist_ok=True)
    if not path.is_file() or path.read_text(encoding="utf-8") != text:
        path.write_text(text, encoding="utf-8")


def point_at_copies(app: Any, name: str, source: list[str]) -> None:
    """Links out of the folder lead to the copies."""
    up = "../" * name.count("/")
    for outside, inside in TAKEN.items():
        source[0] = source[0].replace(f"]({up}{outside}", f"]({up}repository/{inside}")


def mark_code(app: Any, what: str, name: str, thing: Any, options: Any, lines: list[str]) -> None:
    """Code between single backticks, as docstrings have it, is code wherever a word goes on."""
    lines[:] = [re.sub(r"(?<!`)`([^`]+)`(?!`)(?=(\w?))", _literal, line) for line in lines]


def _literal(match: re.Match[str]) -> str:
    is_public = match[1] in barnax.__all__
    code = f":py:obj:`{match[1]} <barnax.{match[1]}>`" if is_public else f"``{match[1]}``"
    return code + ("\\ " if match[2] else "")


def mark_options(app: Any, tree: Any, page: str) -> None:
    """Names of options and circuits do not break at their dashes."""
    for code in tree.findall(literal):
        text = code.astext()
        if "-" in text and " " not in text and len(text) < LONGEST_UNBROKEN:
            code["classes"].append("option")


def write_inline_math(page: Any, node: Any) -> None:
    page.body.append(tex2mathml(node.astext()))
    raise SkipNode


def write_displayed_math(page: Any, node: Any) -> None:
    page.body.append(f'<div class="math">{tex2mathml(node.astext(), as_block=True)}</div>')
    raise SkipNode


def setup(app: Any) -> None:
    app.add_html_math_renderer("mathml", (write_inline_math, None), (write_displayed_math, None))
    app.connect("autodoc-process-docstring", add_types)
    app.connect("autodoc-process-docstring", mark_code)
    app.connect("autodoc-process-signature", show_call)
    app.connect("builder-inited", copy_pages)
    app.connect("source-read", point_at_copies)
    app.connect("doctree-resolved", mark_options)
