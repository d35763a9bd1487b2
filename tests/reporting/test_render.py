"""One document, two forms: whole, self-contained, and safe whatever the names of files are."""

import base64
import hashlib
import re
import shutil
import subprocess
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st
from markdown_it import MarkdownIt
from matplotlib.figure import Figure

import barnax
from barnax.plots import column_width, plot_ocv
from barnax.reporting.document import Bullets, Head, Page, Paragraph, Picture, ReportTable, Section
from barnax.reporting.identification import identification_document
from barnax.reporting.illustrations import identification_illustrations
from barnax.reporting.render import escape_markdown, paper_files, to_html, to_markdown
from helpers.hostile import EXAMPLES, LETTERS, names, repeated
from helpers.report_reader import ReportReader

HOSTILE = (
    "<script>alert(1)</script>.csv",
    '"><img src=x onerror=alert(1)>.csv',
    "{{ 7 * 7 }}{% for x in y %}.csv",
    "a|b*c*_d_`e`[f](http://g)$h$~i~&lt;.csv",
    "# 1. - > +.csv",
    "\u202efdp.exe\x00\x1b[31m\udcff.csv",
    "line\nbreak\r\n\r\nand more.csv",
)
PICTURE = Picture("figure", Figure, "a caption", "an alt")


def make_document(text="plain", pictures=(PICTURE,)):
    table = ReportTable(
        f"caption {text}",
        (Head("row", role="text"), Head("RMSE", "mV")),
        ((text, "1.0"), ("other", "-22.5")),
        frozenset({(0, 1)}),
    )
    blocks = (Paragraph(text), Bullets((text, text)), Bullets((text,), True), table)
    return Page(text, text, (Section(text, (*blocks, *pictures)), Section("last", ())))


def rendered(markdown):
    return MarkdownIt("commonmark").enable(["table", "strikethrough"]).render(markdown)


def test_a_page_is_well_formed_and_needs_nothing_but_itself():
    html = to_html(make_document())
    page = ReportReader(html)
    assert page.open == []
    assert [page.count(tag) for tag in ("html", "h1", "h2", "table", "img")] == [*(1, 1, 2, 1, 1)]
    assert all(each.startswith(("data:", "#")) for each in page.references)
    foreign = {"script", "iframe", "object", "embed", "base", "form"}
    assert foreign.isdisjoint(tag for tag, _ in page.tags)
    assert not re.search(r"@import|url\(", html)
    policy = next(each["content"] for _, each in page.tags if each.get("http-equiv"))
    assert policy == "default-src 'none'; img-src data:; style-src 'unsafe-inline'"
    places = {attributes.get("id") for _, attributes in page.tags}
    assert {each.removeprefix("#") for each in page.references if each[0] == "#"} <= places
    # Pictures have words, and heads say what they head.
    (image,) = [attributes for tag, attributes in page.tags if tag == "img"]
    assert image["alt"] == "an alt"
    content = (image["src"] or "").removeprefix("data:image/png;base64,")
    assert base64.b64decode(content) == PICTURE.content
    scopes = [attributes.get("scope") for tag, attributes in page.tags if tag == "th"]
    assert scopes == ["col", "col", "row", "row"]


def read(document):
    """Both forms of a document, as they are read."""
    return ReportReader(to_html(document)), ReportReader(rendered(to_markdown(document)))


def tags_of(text):
    """The tags of both forms of a document of this text."""
    return [[tag for tag, _ in each.tags] for each in read(make_document(text))]


@pytest.mark.parametrize("examples", EXAMPLES)
def test_a_report_of_any_name_has_the_same_parts(examples):
    def survive(name):
        assert tags_of(f"a{name}") == tags_of("plain")

    repeated(examples, survive, names())


@pytest.mark.parametrize("name", HOSTILE, ids=range(len(HOSTILE)))
def test_a_hostile_name_is_shown_and_does_nothing(name):
    assert tags_of(name) == tags_of("plain")
    page, markdown = read(make_document(name))
    assert all(not key.startswith("on") for _, attributes in page.tags for key in attributes)
    seen = re.sub(r"[\x00\r\x1b\u202e\udcff]", "\N{REPLACEMENT CHARACTER}", name)
    assert "".join(seen.split()) in "".join(page.text.split())
    for form in (to_html, to_markdown):
        text = form(make_document(name))
        text.encode("utf-8")
        assert all(letter in "\n\t" or letter.isprintable() for letter in text)
    assert set(markdown.references) == {"figures/figure.png"}


@given(st.text(LETTERS, min_size=1))
def test_escaped_text_is_one_line_that_renders_as_itself(text):
    words = " ".join(text.split())
    if not words or not words.isprintable():
        return
    page = ReportReader(rendered(escape_markdown(text)))
    assert [tag for tag, _ in page.tags] == ["p"]
    assert page.text.strip() == words


def test_both_forms_say_the_same():
    document = make_document("On a.csv it errs by 1.5 mV.")
    page, markdown = read(document)

    def words(text):
        return [word for word in re.split(r"[\s\[\]]+", text) if word]

    # The page names its sections once more, in its contents.
    contents = words(" ".join(section.title for section in document.sections))
    title = words(document.title)
    assert sorted(words(page.text)) == sorted([*words(markdown.text), *contents, *title])


def test_a_table_whose_rows_do_not_fit_its_columns_is_refused():
    with pytest.raises(ValueError, match="a row of 2 cells under 1 columns"):
        ReportTable("", (Head("one"),), (("1", "2"),))


def test_figures_for_a_paper_are_pdf_and_svg_as_wide_as_a_column():
    cell = barnax.characterize([barnax.read_record(barnax.bundled_file("ocv_discharge"))])
    with column_width():
        files = paper_files([Picture("ocv", lambda: plot_ocv(cell), "", "")])
    assert set(files) == {"figures/paper/ocv.pdf", "figures/paper/ocv.svg"}
    assert re.search(rb"/MediaBox \[ 0 0 252 ", files["figures/paper/ocv.pdf"])
    assert b'width="252pt"' in files["figures/paper/ocv.svg"]


# Interactive figures: the page is whole without them, and lets no other script run.

BROWSER = shutil.which("chromium") or shutil.which("google-chrome") or shutil.which("chrome")
SCRIPT = "</script><script>alert(1)</script>"
DATA = {"label": SCRIPT, "columns": ["AAAA"], "panels": []}
LIVE = replace(PICTURE, live=lambda: (DATA, "a moving one"))
LARGEST_REPORT = 6_000_000


def test_the_policy_allows_the_page_s_one_script_by_its_hash_and_no_other():
    page = to_html(Page("t", "s", (Section("one", (LIVE,)),)))
    scripts = re.findall(r"<script( [^>]*)?>(.*?)</script>", page, re.DOTALL)
    (script,) = [text for kind, text in scripts if not kind]
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


@pytest.mark.slow
@pytest.mark.skipif(BROWSER is None, reason="there is no Chromium here")
def test_in_a_browser_every_interactive_figure_is_drawn_and_the_console_is_empty(tmp_path):
    result = barnax.identify(over="soc", seeds=4, iterations=60)
    document = identification_document(result, identification_illustrations(result, live=True))
    report = tmp_path / "report.html"
    report.write_text(to_html(document), encoding="utf-8")
    command = [BROWSER, "--headless", "--no-sandbox", "--disable-gpu", "--enable-logging=stderr"]
    command += ["--virtual-time-budget=5000", "--dump-dom", report.as_uri()]
    done = subprocess.run(command, capture_output=True, timeout=120, check=True)
    assert b"CONSOLE" not in done.stderr
    page = done.stdout.decode()
    figures = re.findall(r'<figure class="([^"]*)"', page)
    assert len(figures) == 2
    assert all(set(each.split()) == {"has-live", "scripted", "live"} for each in figures)
    assert page.count("<canvas") == 3 + 3
    assert report.stat().st_size < LARGEST_REPORT
