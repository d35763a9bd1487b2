"""Interactive figures: the page is whole without them, and lets no other script run."""

import base64
import hashlib
import json
import re
import shutil
import subprocess
from html import unescape
from pathlib import Path

import pytest
from report_reader import ReportReader

import barnax
from barnax.reporting.document import Document, Live, Picture, Section
from barnax.reporting.identification import identification_document
from barnax.reporting.illustrations import identification_illustrations
from barnax.reporting.render import to_html

TEMPLATES = Path(barnax.__file__).parent / "reporting" / "templates"
BROWSER = shutil.which("chromium") or shutil.which("google-chrome") or shutil.which("chrome")
HOSTILE = "</script><script>alert(1)</script>"
DATA = {"kind": "soc", "label": HOSTILE, "columns": [[0.0, 1.0], [1.0, None]], "panels": []}
LIVE = Picture("f", "a still", "an alt", "image/png", b"\x89PNG", Live(DATA, "a moving one"))
LARGEST_REPORT = 6_000_000
MOST_PAGES = 8


@pytest.fixture(scope="module")
def page():
    return to_html(Document("t", "s", (Section("one", (LIVE,)),)))


def scripts_of(page):
    return re.findall(r"<script( [^>]*)?>(.*?)</script>", page, re.DOTALL)


def test_the_policy_allows_the_page_s_one_script_by_its_hash_and_no_other(page):
    (script,) = [text for kind, text in scripts_of(page) if not kind]
    digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    policy = next(
        attributes["content"]
        for _, attributes in ReportReader(page).tags
        if attributes.get("http-equiv")
    )
    assert policy == (
        "default-src 'none'; img-src data:; style-src 'unsafe-inline'; "
        f"script-src 'sha256-{digest}'"
    )


def test_the_data_come_through_whatever_letters_are_in_them(page):
    (data,) = [text for kind, text in scripts_of(page) if "json" in kind]
    assert json.loads(data) == DATA
    assert ReportReader(page).open == []


def test_without_the_script_the_picture_stands_with_its_own_caption(page):
    reader = ReportReader(page)
    (image,) = [attributes for tag, attributes in reader.tags if tag == "img"]
    assert image["alt"] == "an alt"
    assert "a still" in reader.text
    style = (TEMPLATES / "report.css").read_text()
    assert ".plots, .tools, .moving { display: none; }" in style


def test_uplot_comes_whole_with_its_licence(page):
    assert (TEMPLATES / "uPlot.LICENSE").read_text().strip() in unescape(page)
    library = (TEMPLATES / "uPlot.iife.min.js").read_text()
    assert library in page
    assert len(library) < 60_000


def luminance(color):
    """Relative luminance (WCAG 2.2)."""
    digits = color[1:] if len(color) == 7 else "".join(2 * digit for digit in color[1:])
    parts = [int(digits[k : k + 2], 16) / 255 for k in (0, 2, 4)]
    linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in parts]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


def test_letters_stand_out_from_what_is_behind_them():
    letters = ("#1b1f24", "#57606a", "#0b4f7d", "#32383f")
    behind = ("#fff", "#f6f8fa", "#fff8e5")
    style = (TEMPLATES / "report.css").read_text()
    assert set(re.findall(r"#[0-9a-f]{3,6}", style)) == {*letters, *behind, "#d0d7de", "#b7791f"}
    for dark, light in ((dark, light) for dark in letters for light in behind):
        assert (luminance(light) + 0.05) / (luminance(dark) + 0.05) >= 4.5


@pytest.fixture(scope="module")
def report(tmp_path_factory):
    """The bundled cell's report with every kind of figure, as a file."""
    result = barnax.identify(over="soc", seeds=4, iterations=60)
    document = identification_document(result, identification_illustrations(result.run))
    path = tmp_path_factory.mktemp("report") / "report.html"
    path.write_text(to_html(document), encoding="utf-8")
    return path


def browse(*options):
    """What a headless browser prints and says on its console."""
    if BROWSER is None:
        pytest.skip("there is no Chromium here")
    command = [BROWSER, "--headless", "--no-sandbox", "--disable-gpu", "--enable-logging=stderr"]
    done = subprocess.run([*command, *options], capture_output=True, timeout=120, check=True)
    said = [line for line in done.stderr.decode().splitlines() if "CONSOLE" in line]
    return done.stdout.decode(), said


@pytest.mark.slow
def test_in_a_browser_every_interactive_figure_is_drawn_and_the_console_is_empty(report):
    page, said = browse("--virtual-time-budget=5000", "--dump-dom", report.as_uri())
    assert said == []
    figures = re.findall(r'<figure class="([^"]*)"', page)
    assert len(figures) == 4
    assert all(set(each.split()) == {"has-live", "scripted", "live"} for each in figures)
    assert page.count("<canvas") == 4 + 3 + 3 + 1
    assert report.stat().st_size < LARGEST_REPORT


@pytest.mark.slow
def test_it_prints_on_eight_pages(report):
    printed = report.with_suffix(".pdf")
    browse("--virtual-time-budget=5000", f"--print-to-pdf={printed}", report.as_uri())
    pages = len(re.findall(rb"/Type\s*/Page\b", printed.read_bytes()))
    assert 1 < pages <= MOST_PAGES
