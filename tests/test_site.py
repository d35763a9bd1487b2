"""The built site, as its readers see it: figures, equations, terms, no request to elsewhere."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

FOLDER = Path(__file__).parents[1] / "docs"
NOTEBOOKS = sorted({path.stem for path in FOLDER.glob("notebooks/*.md")} - {"index"})
INDEX = (FOLDER / "index.md").read_text(encoding="utf-8")
GUIDES = re.findall(r"^[a-z-]+$", re.search(r":caption: Do\n(.*?)```", INDEX, re.S)[1], re.M)
# Cells that end with a figure.
DRAWS = re.compile(r"^(?:\w+\.figure\(.*\)|barnax\.plots\.plot_\w+\(.*\)|axes\.set\(.*\);)$")
pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """The folder of the site, built with its notebooks run; a warning fails it."""
    pytest.importorskip("sphinx", reason="the site needs the extra docs")
    folder = tmp_path_factory.mktemp("site")
    # What was kept of earlier runs may be of other code.
    build = ["-q", "-W", "--keep-going", "-j", "auto", "-D", "nb_execution_mode=force"]
    done = subprocess.run(
        [sys.executable, "-m", "sphinx", *build, str(FOLDER), str(folder)],
        capture_output=True,
        text=True,
        timeout=900,
    )
    assert done.returncode == 0, done.stderr[-3000:]
    return folder


def article(site, page):
    """The page without what surrounds it."""
    text = (site / f"{page}.html").read_text(encoding="utf-8")
    return re.search(r'<article role="main".*?</article>', text, re.S)[0]


def images(site, page):
    """The number of pictures of a page."""
    text = article(site, page)
    return text.count("<img") + text.count("<svg")


@pytest.mark.parametrize("page", ["index", "getting-started", "read-the-answer", *GUIDES])
def test_a_guide_has_a_picture(site, page):
    assert images(site, page)


@pytest.mark.parametrize("name", NOTEBOOKS)
def test_a_notebook_shows_a_figure_wherever_a_cell_ends_with_one(site, name):
    text = (FOLDER / "notebooks" / f"{name}.md").read_text(encoding="utf-8")
    cells = re.findall(r"^```\{code-cell\} ipython3\n(.*?)\n```", text, re.M | re.S)
    drawn = sum(bool(DRAWS.match(cell.splitlines()[-1])) for cell in cells)
    assert images(site, f"notebooks/{name}") >= max(drawn, 1)
    assert "&lt;Figure" not in article(site, f"notebooks/{name}")


def test_no_directive_or_formula_is_shown_as_text(site):
    for path in site.rglob("*.html"):
        shown = re.sub(
            r"<(pre|code|script|style)\b.*?</\1>", "", path.read_text("utf-8"), flags=re.S
        )
        assert not re.search(r":::|\$\$|\{glossary\}|\\frac", shown), path
    assert article(site, "glossary").count("<dt") > 20
    assert all("<math" in article(site, page) for page in ("models", "theory"))


def test_the_reference_shows_readable_types(site):
    pages = [path.relative_to(site).with_suffix("").as_posix() for path in site.glob("api/*.html")]
    shown = "".join(re.sub(r"<[^>]+>", "", article(site, page)) for page in pages)
    assert "identify(" in shown
    assert not re.search(r"\bAny\b|FieldInfo|Annotated|\*\*options|&lt;function|jaxtyping", shown)
    assert "temperature_degc (float, in °C)" in shown


def test_a_page_loads_nothing_from_elsewhere(site):
    for path in site.rglob("*.html"):
        text = path.read_text(encoding="utf-8")
        loaded = re.findall(r'<(?:script|img|iframe)[^>]* src="(?:https?:)?//[^"]*"', text)
        loaded += re.findall(r'<link[^>]*rel="stylesheet"[^>]*href="(?:https?:)?//[^"]*"', text)
        assert not loaded, path
