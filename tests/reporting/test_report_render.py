"""One document, two forms: whole, self-contained, and safe whatever the names of files are."""

import base64
import re

import pytest
from hypothesis import given
from hypothesis import strategies as st
from markdown_it import MarkdownIt
from report_reader import ReportReader

from barnax import bundled_file, characterize, read_record
from barnax.plots import column_width, plot_ocv
from barnax.plots.pictures import Illustration
from barnax.reporting import Document, Picture, paper_files, to_html, to_markdown
from barnax.reporting.document import Bullets, Column, Listing, Paragraph, Section, Table
from barnax.reporting.render import escape_markdown, table_lines

HOSTILE = (
    "<script>alert(1)</script>.csv",
    '"><img src=x onerror=alert(1)>.csv',
    "{{ 7 * 7 }}{% for x in y %}.csv",
    "a|b*c*_d_`e`[f](http://g)$h$~i~&lt;.csv",
    "# 1. - > +.csv",
    "\u202efdp.exe\x00\x1b[31m\udcff.csv",
    "line\nbreak\r\n\r\nand more.csv",
)
PICTURE = Picture("figure", "a caption", "an alt", "image/png", b"\x89PNG")


def make_document(text="plain", pictures=(PICTURE,)):
    table = Table(
        f"caption {text}",
        (Column("row", role="text"), Column("RMSE", "mV")),
        ((text, "1.0"), ("other", "-22.5")),
        frozenset({(0, 1)}),
    )
    blocks = (Paragraph(text), Bullets((text, text)), Bullets((text,), True), Listing(text), table)
    return Document(text, text, (Section(text, (*blocks, *pictures)), Section("last", ())))


def test_a_page_is_well_formed_and_complete():
    page = ReportReader(to_html(make_document()))
    assert page.open == []
    assert [page.count(tag) for tag in ("html", "h1", "h2", "table", "img", "pre")] == [
        1,
        1,
        2,
        1,
        1,
        1,
    ]


def test_a_page_needs_nothing_but_itself():
    html = to_html(make_document())
    page = ReportReader(html)
    assert page.references
    assert all(each.startswith(("data:", "#")) for each in page.references)
    assert {"script", "iframe", "object", "embed", "base", "form"}.isdisjoint(
        t for t, _ in page.tags
    )
    assert not re.search(r"@import|url\(", html)
    policy = next(a["content"] for t, a in page.tags if a.get("http-equiv"))
    assert policy == "default-src 'none'; img-src data:; style-src 'unsafe-inline'"


def test_every_place_that_is_linked_to_is_there():
    page = ReportReader(to_html(make_document()))
    places = {attributes.get("id") for _, attributes in page.tags}
    assert {each.removeprefix("#") for each in page.references if each[0] == "#"} <= places


def test_a_picture_is_in_the_page_with_words_for_who_cannot_see_it():
    page = ReportReader(to_html(make_document()))
    (attributes,) = [attributes for tag, attributes in page.tags if tag == "img"]
    assert attributes["alt"] == "an alt"
    content = (attributes["src"] or "").removeprefix("data:image/png;base64,")
    assert base64.b64decode(content) == PICTURE.content


def test_the_heads_of_a_table_say_what_they_head():
    page = ReportReader(to_html(make_document()))
    scopes = [attributes.get("scope") for tag, attributes in page.tags if tag == "th"]
    assert scopes == ["col", "col", "row", "row"]


@pytest.mark.parametrize("name", HOSTILE, ids=range(len(HOSTILE)))
def test_a_hostile_name_is_shown_and_does_nothing(name):
    plain, hostile = (
        ReportReader(to_html(make_document())),
        ReportReader(to_html(make_document(name))),
    )
    assert [tag for tag, _ in hostile.tags] == [tag for tag, _ in plain.tags]
    assert all(not key.startswith("on") for _, attributes in hostile.tags for key in attributes)
    seen = re.sub(r"[\x00\r\x1b\u202e\udcff]", "\N{REPLACEMENT CHARACTER}", name)
    assert "".join(seen.split()) in "".join(hostile.text.split())


@pytest.mark.parametrize("form", [to_html, to_markdown])
@pytest.mark.parametrize("name", HOSTILE, ids=range(len(HOSTILE)))
def test_a_report_holds_only_letters_that_can_be_stored_and_seen(form, name):
    text = form(make_document(name))
    text.encode("utf-8")
    assert all(letter in "\n\t" or letter.isprintable() for letter in text)


def rendered(markdown):
    return MarkdownIt("commonmark").enable(["table", "strikethrough"]).render(markdown)


@pytest.mark.parametrize("name", HOSTILE, ids=range(len(HOSTILE)))
def test_markdown_of_a_hostile_name_renders_as_that_name(name):
    plain, hostile = (
        ReportReader(rendered(to_markdown(make_document(text)))) for text in ("plain", name)
    )
    assert [tag for tag, _ in hostile.tags] == [tag for tag, _ in plain.tags]
    assert set(hostile.references) == {"figures/figure.png"}


@given(st.text(alphabet=st.characters(codec="utf-8"), min_size=1))
def test_escaped_text_is_one_line_that_renders_as_itself(text):
    words = " ".join(text.split())
    if not words or not words.isprintable():
        return
    page = ReportReader(rendered(escape_markdown(text)))
    assert [tag for tag, _ in page.tags] == ["p"]
    assert page.text.strip() == words


def test_units_and_names_of_files_are_not_cluttered_with_escapes():
    text = "dst_25degC_80soc.csv: R0 [mOhm] 1.5, -3 % (a-b)"
    assert escape_markdown(text) == text


def test_columns_of_a_table_are_aligned_in_the_source():
    columns = (Column("a row", role="text"), Column("RMSE", "mV"))
    rows = (("电池", "1.0"), ("a|b", "-22.25"))
    assert table_lines(Table("", columns, rows, frozenset({(0, 1)}))).splitlines() == [
        "| a row | RMSE [mV] |",
        "| ----- | --------: |",
        "| 电池  |   **1.0** |",
        r"| a\|b  |    -22.25 |",
    ]


def test_both_forms_say_the_same():
    document = make_document("On a.csv it errs by 1.5 mV.")
    page, markdown = ReportReader(to_html(document)), ReportReader(rendered(to_markdown(document)))

    def words(text):
        return [word for word in re.split(r"[\s\[\]]+", text) if word]

    # The page names its sections once more, in its contents.
    contents = words(" ".join(section.title for section in document.sections))
    title = words(document.title)
    assert sorted(words(page.text)) == sorted([*words(markdown.text), *contents, *title])


def test_markdown_looks_for_its_figures_in_the_folder_it_is_told():
    svg = Picture("drawn", "", "", "image/svg+xml", b"<svg/>")
    text = to_markdown(make_document(pictures=(PICTURE, svg)), figures="pictures")
    assert re.findall(r"\]\((.*?)\)", text) == ["pictures/figure.png", "pictures/drawn.svg"]


def test_markdown_has_no_run_of_empty_lines():
    assert "\n\n\n" not in to_markdown(make_document())


def test_tables_and_figures_are_numbered_through():
    document = make_document(pictures=(PICTURE, PICTURE))
    for text in (ReportReader(to_html(document)).text, to_markdown(document).replace("*", "")):
        assert [f"Figure {n}." in text for n in (1, 2, 3)] == [True, True, False]
        assert [f"Table {n}." in text for n in (1, 2)] == [True, False]


def test_figures_for_a_paper_are_pdf_and_svg_as_wide_as_a_column():
    cell = characterize([read_record(bundled_file("ocv_discharge"))])
    with column_width():
        figure = plot_ocv(cell)
    files = paper_files([Illustration("ocv", figure, "", "")])
    assert set(files) == {"figures/paper/ocv.pdf", "figures/paper/ocv.svg"}
    assert re.search(rb"/MediaBox \[ 0 0 252 ", files["figures/paper/ocv.pdf"])
    assert b'width="252pt"' in files["figures/paper/ocv.svg"]
