"""`barnax validate`: identified parameters on another record of the same cell."""

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from . import options
from .options import parse_steps
from .session import Session, use_compilation_cache

if TYPE_CHECKING:
    from ..model.inputs import Window

# What belongs to a start: either start takes the stored one's place, whichever that was, and the
# stored state of charge was that of another moment.
START = ("start_time_s", "start_after_step", "initial_soc")
SCORING = ("score_steps", "score_from_s", "score_to_s")


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
    whole_record: Annotated[
        bool,
        typer.Option(
            "--whole-record",
            help="Forget the stored start, its state of charge, and what was scored.",
            rich_help_panel=options.WINDOW,
        ),
    ] = False,
    as_json: Annotated[
        bool,
        typer.Option("--json", help="Print the errors as JSON.", rich_help_panel=options.OUTPUT),
    ] = False,
    quiet: options.Quiet = False,
) -> None:
    """Simulate an identified circuit on another record and print its errors.

    The window of the identification applies, except where options change it.
    Another start also drops the stored state of charge.
    """
    session = Session(is_quiet=quiet or as_json)
    with session.stage("Loading JAX"):
        use_compilation_cache()
        from ..records import read_record
        from ..reporting.terminal import metrics_table
        from ..results import Result, metrics_part
        from ..search.evaluate import validate as validate_on

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
    given = {name: value for name, value in chosen.items() if value is not None}
    window = _window(stored.window, given, whole_record)
    with session.stage("Reading the record"):
        measured = read_record(record, current_sign=current_sign, current_hold=current_hold)
    with session.stage("Simulating"):
        evaluation = validate_on(
            measured, stored.cell_model, stored.model, stored.circuit_parameters, window
        )
    if as_json:
        typer.echo(metrics_part(evaluation).model_dump_json(by_alias=True, indent=1))
    session.show([metrics_table([evaluation])])
    session.warn([*measured.warnings, *evaluation.prepared.warnings])


def _window(stored: "Window", given: dict[str, Any], is_whole: bool) -> "Window":
    """The stored window with the given parts in place, without what they make void."""
    void: tuple[str, ...] = ()
    if is_whole:
        void = START + SCORING
    elif "start_time_s" in given or "start_after_step" in given:
        void = START
    return replace(stored, **(dict.fromkeys(void) | given))
