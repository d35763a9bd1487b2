"""The report of a result as a text: a page of HTML, a part of one, or Markdown."""

from html import escape
from pathlib import Path

from ..errors import InputError
from ..files import write_whole
from ..results import Result
from .identification import identification_document
from .illustrations import identification_illustrations
from .render import picture_suffix, to_fragment, to_html, to_markdown


class Report(str):
    """The text of a report, which a notebook shows as the page that it is."""

    __slots__ = ()

    def __repr__(self) -> str:
        return f"Report(<{len(self):,} characters>)"

    def _repr_html_(self) -> str | None:
        if not self.startswith("<!"):
            return None
        return f'<iframe srcdoc="{escape(self)}" style="width:100%;height:40em;border:0"></iframe>'


def report_of(result: Result, path: str | Path | None, format: str | None) -> Report:
    """`Result.report`."""
    form = format or (Path(path).suffix[1:] if path else "") or "html"
    if form not in ("html", "md"):
        raise InputError(
            f"a report is html or md, not {form!r}; name the file so, or set its format"
        )
    drawn = identification_illustrations(result)
    document = identification_document(result, drawn)
    text = to_html(document) if form == "html" else to_markdown(document)
    if path is not None:
        place = Path(path)
        if form == "md":
            for picture in document.pictures:
                name = f"{picture.name}{picture_suffix(picture)}"
                write_whole(place.parent / "figures" / name, picture.content)
        write_whole(place, text.encode())
    return Report(text)


def fragment_of(result: Result) -> str:
    """A result as a notebook shows it."""
    return to_fragment(identification_document(result, summary_only=True))
