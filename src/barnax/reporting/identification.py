"""The report of one identification: as a document, as a text, and in a notebook."""

from collections.abc import Iterable
from html import escape
from pathlib import Path

from ..errors import InputError
from ..files import write_whole
from ..results import Result
from .document import Block, Document, Picture, Pictures
from .illustrations import identification_illustrations, record_roles
from .pulses import pulses_blocks
from .render import to_fragment, to_html, to_markdown
from .result_tables import (
    assessment_tables,
    circuit_blocks,
    errors_table,
    files_table,
    parameters_table,
    plan_table,
    search_boxes,
    seed_tables,
    versions_table,
)
from .soc_tables import answer_tables, ocv_tables, other_temperatures
from .view import View
from .wording import document


def identification_document(
    result: Result, illustrations: Iterable[Picture] = (), *, summary_only: bool = False
) -> Document:
    """The whole report of an identification, ready for HTML, Markdown or a terminal.

    `illustrations` come from `identification_illustrations`; `summary_only` leaves it at the
    parameters, the verdict and the errors.
    """
    view, pictures = View(result), Pictures(illustrations)
    roles = record_roles(len(view.identified), len(view.validation))
    has_tables = result.tables is not None
    values = answer_tables(result.fits) if has_tables else (parameters_table(result),)

    def of_records(*kinds: str) -> tuple[Picture, ...]:
        return pictures.of(*(f"{role}-{kind}" for role in roles for kind in kinds))

    blocks: dict[str, tuple[Block, ...]] = {
        "answer": (*pictures.of("summary"), *values),
        "errors": (errors_table(result), *of_records("voltage", "error")),
    }
    if not summary_only:
        validated = [part.name for part in view.validation]
        assessment = result.constant.assessment
        blocks |= {
            "circuits": circuit_blocks(view.candidates, result.tried, validated),
            "tables": (*other_temperatures(result.fits), *pictures.starting("tables")),
            "ocv nodes": ocv_tables(result.fits),
            "pulses": pulses_blocks(result, of_records("pulses", "resistances")),
            "assessment": assessment_tables(assessment) if assessment else (),
            "files": (
                files_table(result),
                *((plan_table(result.plan),) if result.plan else ()),
                *pictures.of("ocv"),
            ),
            "seeds": (*seed_tables(result), *pictures.of("convergence")),
            "versions": (versions_table(result),),
        }
        blocks["more figures"] = pictures.others()
    constant = result.constant
    boxes = search_boxes({constant.model: (constant.bounds, constant.fixed)})
    return document("report", blocks, view=view, search_boxes=boxes, summary_only=summary_only)


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
