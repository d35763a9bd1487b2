"""`barnax report`: the page of any stored result."""

import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from ..errors import InputError
from .options import DATA, FORCE, LIVE, OUTPUT, argument, group, option
from .output import RESULTS, add_file, require_free_file
from .session import Session, as_flags, use_compilation_cache

if TYPE_CHECKING:
    from ..reporting.document import Document

PAGE = "report.html"


@group
class Stored:
    """A stored result, and the file for its page."""

    result: Path = argument(
        "RESULT",
        "The folder that identify, hppc, compare, soc or fleet wrote, or its result.json, "
        "comparison.json or soc.json.",
    )
    out: Path | None = option(OUTPUT, "FILE", "The page (default: report.html beside the result).")
    data: list[Path] | None = DATA
    live: bool = LIVE
    force: bool = FORCE


def report(of: Stored) -> None:
    """Write the report of a stored result as one HTML page.

    The figures of identify and hppc are drawn again from the measured files. Where
    those are not found, and for compare and soc, figures over time are left out.
    """
    place = of.result if of.result.is_dir() else of.result.parent
    out = of.out or place / PAGE
    require_free_file(out, of.force)
    session = Session(is_quiet=False)
    with session.watch("Writing the report"):
        from ..reporting.render import to_html

        document, missing = _document(_file_of(of.result), of.data or (), of.live)
        if missing:
            left_out = f"{document.summary} Figures over time are left out: {missing}."
            document = replace(document, summary=left_out.strip())
        add_file(out, to_html(document.with_option_names(as_flags)).encode())
    if missing:
        session.warn([f"figures over time are left out: {missing}"])
    session.show([str(out)])


def _file_of(path: Path) -> Path:
    """The file that holds a result; a fleet's own folder."""
    if not path.is_dir():
        return path
    found = [path / name for name in RESULTS if (path / name).is_file()]
    if found:
        return found[0]
    if (path / "cells.parquet").is_file():
        return path
    raise InputError(f"{path}: holds no result; give the folder that a command of barnax wrote")


def _document(path: Path, data: Sequence[Path], live: bool) -> "tuple[Document, str]":
    """The document of what is stored, and why figures over time are missing, if they are."""
    if path.is_dir():
        from ..fleet.summary import read_fleet, summarize
        from ..reporting.fleet import fleet_document, fleet_illustrations

        rows = read_fleet(path)
        missing = "the worst fits are drawn by barnax fleet, with its manifest"
        return fleet_document(summarize(rows), fleet_illustrations(rows, {})), missing
    use_compilation_cache()
    keys = _keys(path)
    if "scenarios" in keys:
        from ..replay import SocReplay
        from ..reporting.replay import replay_document

        missing = "soc.json has no estimates over time; barnax soc --report draws them"
        return replay_document(SocReplay.from_json(path)), missing
    if "rows" in keys:
        from ..comparison import ComparisonResult
        from ..reporting.comparison import comparison_document
        from ..reporting.illustrations import comparison_illustrations

        stored = ComparisonResult.from_json(path)
        missing = "comparison.json has no records; barnax compare draws them"
        return comparison_document(stored, comparison_illustrations(stored)), missing
    from ..reporting.identification import identification_document
    from ..reporting.illustrations import identification_illustrations, stored_illustrations
    from ..results import Result

    result, missing = Result.load(path, data=data), ""
    try:
        drawn = identification_illustrations(result, live=live)
    except InputError as problem:
        drawn, missing = stored_illustrations(result), str(problem)
    return identification_document(result, drawn), missing


def _keys(path: Path) -> set[str]:
    """The keys of a file; what is no JSON is refused by whoever reads it as a result."""
    try:
        return {*json.loads(path.read_text(encoding="utf-8"))}
    except (OSError, ValueError, TypeError, RecursionError):
        return set()
