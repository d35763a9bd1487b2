"""`barnax validate`: identified parameters on another record of the same cell."""

from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer

from . import options
from .options import parse_steps
from .session import Session, use_compilation_cache


def validate(
    result: Annotated[Path, typer.Argument(metavar="RESULT.json", help="What identify wrote.")],
    record: Annotated[Path, typer.Argument(metavar="RECORD", help="Record to validate on.")],
    current_sign: options.CurrentSign = "auto",
    current_hold: options.CurrentHold = "auto",
    rest_current: options.RestCurrent = None,
    initial_direction: options.InitialDirection = None,
    start_time: options.StartTime = None,
    start_after_step: options.StartAfterStep = None,
    initial_soc: options.InitialSoc = None,
    score_steps: options.ScoreSteps = None,
    score_from: options.ScoreFrom = None,
    score_to: options.ScoreTo = None,
    as_json: Annotated[
        bool,
        typer.Option("--json", help="Print the errors as JSON.", rich_help_panel=options.OUTPUT),
    ] = False,
    quiet: options.Quiet = False,
) -> None:
    """Simulate an identified circuit on another record and print its errors.

    The window of the identification applies, except where options change it.
    """
    session = Session(is_quiet=quiet or as_json)
    with session.stage("Loading JAX"):
        use_compilation_cache()
        from ..evaluate import validate as validate_on
        from ..records import read_record
        from ..report import metrics_table
        from ..result import Result, metrics_part

    stored = Result.from_json(result)
    chosen = {
        "start_time_s": start_time,
        "start_after_step": start_after_step,
        "initial_soc": initial_soc,
        "score_steps": parse_steps(score_steps),
        "score_from_s": score_from,
        "score_to_s": score_to,
        "rest_current_a": rest_current,
        "initial_direction": initial_direction,
    }
    changes = {name: value for name, value in chosen.items() if value is not None}
    if start_time is not None or start_after_step is not None:
        # Either start takes the place of the stored one, whichever that was.
        changes = {"start_time_s": start_time, "start_after_step": start_after_step} | changes
    window = replace(stored.window, **changes)
    with session.stage("Reading the record"):
        measured = read_record(record, current_sign=current_sign, current_hold=current_hold)
    with session.stage("Simulating"):
        evaluation = validate_on(
            measured, stored.cell_model, stored.model, stored.circuit_parameters, window
        )
    if as_json:
        typer.echo(metrics_part(evaluation).model_dump_json(by_alias=True, indent=1))
        return
    session.show([metrics_table([evaluation])])
    session.warn([*measured.warnings, *evaluation.course.warnings])
