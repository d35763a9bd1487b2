"""The report of one identification: as a document, as a text, and in a notebook."""

from collections.abc import Iterable, Mapping
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..errors import InputError
from ..files import write_whole
from ..results import Result
from .document import Page, Picture
from .illustrations import identification_illustrations
from .pulses import pulse_facts
from .render import to_fragment, to_html, to_markdown
from .view import View
from .wording import document
from .words import gathered

if TYPE_CHECKING:
    from ..comparison.result import ModelPart
    from ..result_parts import ConstantPart


def identification_document(
    result: Result, illustrations: Iterable[Picture] = (), *, summary_only: bool = False
) -> Page:
    """The whole report of an identification, ready for HTML, Markdown or a terminal.

    `illustrations` come from `identification_illustrations`; with `summary_only` it has the
    parameters, the verdict and the errors only.
    """
    constant = result.constant
    boxes = search_boxes({constant.model: constant})
    facts = {"search_boxes": boxes, "summary_only": summary_only, "pulses": pulse_facts(result)}
    return document("report", illustrations, view=View(result), **facts)


def search_boxes(searched: "Mapping[str, ConstantPart | ModelPart]") -> list[tuple[Any, ...]]:
    """Every search box: the names of each range, the fixed values, and its models."""
    alike = gathered(
        ((tuple(box.bounds.items()), tuple(box.fixed.items())), model)
        for model, box in searched.items()
    )
    return [
        (gathered((ends, name) for name, ends in bounds), held, models)
        for (bounds, held), models in alike.items()
    ]


class Report(str):
    """The text of a report, which a notebook shows as the HTML page."""

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
    report = identification_document(result, identification_illustrations(result))
    text = to_html(report) if form == "html" else to_markdown(report)
    if path is not None:
        file = Path(path)
        if form == "md":
            for picture in report.pictures:
                name = f"{picture.name}{picture.suffix}"
                write_whole(file.parent / "figures" / name, picture.content)
        write_whole(file, text.encode())
    return Report(text)


def fragment_of(result: Result) -> str:
    """A result as a notebook shows it."""
    return to_fragment(identification_document(result, summary_only=True))
