"""`barnax compare`: models and methods side by side on one cell; `barnax optimizers`."""

import itertools
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Annotated

import barnax

from .. import reporting
from ..errors import InputError
from .options import Given, options_of, options_of_job
from .output import DEFAULT_FOLDER, Output, drawn_files
from .session import Session

# Sections of the report on the terminal, unless everything is requested.
SHOWN = {*("Circuits", "Verdict", "Parameters", "Search"), *("Identification", "Validation")}


def compare(
    *,
    job: Annotated[Given, options_of("files", "records", "search", "setup")],
    models: str | None = None,
    methods: str | None = None,
    record: Path | None = None,
    output: Output,
    live: bool = False,
    paper: bool = False,
) -> None:
    """Compare circuits and methods on one cell, in a report.

    First come the usual circuits and tables over SOC, each at its best. Then come
    methods, with the same data, bounds, budget and key, and their answers before
    refinement.

    Without arguments, it runs the paper's five rows on the bundled cell.

    Arguments:
        record (RECORD): Dynamic record to identify on. For a folder or a plan, files are chosen as
            by identify. Without it, the bundled cell is used.

    Search:
        models (NAME,NAME): Circuits, each with every method (default: the five rows of the paper).
        methods (NAME,NAME): Methods, each with every circuit: ls, rls, wrls, rls-ekf, dual-ukf,
            n4sid, varpro, lm, pso-lm, de, or any that barnax optimizers lists.
    """
    run = output.begun(DEFAULT_FOLDER)
    from ..comparison import PAPER_ROWS

    rows, records = chosen_rows(models, methods, PAPER_ROWS), [record] if record else []
    asked = barnax.ComparisonJob(records, **options_of_job(job), rows=rows, watch=run.watch)
    plan = barnax.plan.plan_of(asked)
    if plan is not None:
        if plan.command == "hppc":
            raise InputError(f"{record}: a pulse test is identified by barnax hppc, not compared")
        plan = plan.on_one
        run.show_document(reporting.wording.document("planned", plan=plan))
        asked = barnax.plan.planned(plan, asked)
    are_drawn = (not barnax.METHODS[method].is_deterministic for _, method in rows)
    total = sum(asked.seeds if is_drawn else 1 for is_drawn in are_drawn)
    with run.watch("Comparing", total) as advance:
        # Every stage is timed; its seeds advance the only bar.
        asked = asked.changed(watch=lambda name, total=0: run.timed(name, advance))
        result = barnax.compare_files(asked)
    seconds = {row.name: run.seconds[row.name] for row in result.rows}
    figures = reporting.illustrations.comparison_illustrations
    draw = partial(figures, result, live=live)
    document_of = partial(reporting.comparison.comparison_document, result, seconds=seconds)
    files = partial(drawn_files, draw, document_of, True, paper)
    run.deliver({"comparison.json": result.to_json()}, files)
    document = reporting.comparison.comparison_document(result, (), seconds)
    if not output.verbose:
        sections = (each for each in document.sections if each.title.partition(":")[0] in SHOWN)
        document = replace(document, sections=tuple(sections))
    run.show_document(document)
    run.warn(result.warnings)
    run.show_written(["report.html", "comparison.json", "figures"])


def chosen_rows(
    models: str | None, methods: str | None, default: Sequence[tuple[str, str]]
) -> list[tuple[str, str]]:
    """Pairs of model and method: the default rows, or all combinations of the given ones.

    If only models are given, they are combined with the default methods, and vice versa.

    >>> chosen_rows("esc", None, [("so-rc", "ls"), ("so-rc", "pso")])
    [('esc', 'ls'), ('esc', 'pso')]
    """
    if models is None and methods is None:
        return list(default)
    usual = zip((models, methods), zip(*default, strict=True), strict=True)
    names = (each if text is None else map(str.strip, text.split(",")) for text, each in usual)
    chosen_models, chosen_methods = map(dict.fromkeys, names)
    return list(itertools.product(chosen_models, chosen_methods))


def optimizers() -> None:
    """List the optimizers that --method accepts."""
    from ..optimizers import summarize_optimizers

    table = reporting.wording.table("comparison.optimizers", summarize_optimizers())
    Session(is_quiet=False).show([reporting.terminal.terminal_table(table)])
