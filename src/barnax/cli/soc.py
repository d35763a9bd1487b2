"""`barnax soc`: how well a stored circuit tells the state of charge along another record."""

from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from .groups import FILTER, WINDOW, flag, grouped, option
from .options import Output, Paper, StoredResult
from .output import write_results
from .record_options import Columns, Hold, RecordOptions, Sign
from .results import load, stored_window
from .session import as_flags, use_compilation_cache

if TYPE_CHECKING:
    from ..replay import SocReplay

FOLDER = Path("barnax-soc")


@dataclass(frozen=True)
class FilterOptions:
    """Which filter replays the record, and what it estimates."""

    filter: Annotated[
        Literal["ekf", "ukf"], option(FILTER, "ekf|ukf", "Extended or unscented Kalman filter.")
    ] = "ekf"
    form: Annotated[
        Literal["joint", "dual"],
        option(
            FILTER,
            "joint|dual",
            "Estimate parameters in the filter's own state (joint) or in a second filter (dual).",
        ),
    ] = "joint"
    estimate: Annotated[
        str,
        option(
            FILTER,
            "NAME,NAME",
            "Parameters to estimate: offset (of the current), capacity, R0, R1, tau1 and so on; '' "
            "for none.",
        ),
    ] = "offset,capacity"
    tables: Annotated[
        bool,
        flag(
            FILTER,
            "--tables/--no-tables",
            "Use the tables over SOC if the result has them, or not.",
        ),
    ] = True

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(name.strip() for name in self.estimate.split(",") if name.strip())


@grouped
def soc(
    result: StoredResult,
    record: Annotated[Path, typer.Argument(metavar="RECORD", help="Record to replay.")],
    of_records: RecordOptions,
    chosen: FilterOptions,
    output: Output,
    current_sign: Sign = "auto",
    current_hold: Hold = "auto",
    columns: Columns = "",
    whole_record: Annotated[
        bool,
        flag(WINDOW, "--whole-record", "Replay the whole record, ignoring the stored window."),
    ] = False,
    paper: Paper = False,
) -> None:
    """Replay a record through a Kalman filter, and say how well the circuit tracks its SOC.

    The filter runs from a right and a wrong start, with a current offset, and
    with a wrong capacity. The window of the identification applies, unless
    options change it.
    """
    session, folder = output.begun(FOLDER, (result, record))
    with session.watch("Loading JAX"):
        use_compilation_cache()
        from ..replay import FilterSettings, replay_soc
        from ..reporting.replay import soc_screen

    stored = load(result)
    window = stored_window(stored, record, of_records, whole_record)
    settings = FilterSettings(chosen.filter, chosen.form, chosen.names, tables=chosen.tables)
    with session.watch("Replaying"):
        replay = replay_soc(
            stored, record, window, settings,
            current_sign=current_sign, current_hold=current_hold, columns=columns,
        )  # fmt: skip
    if folder is not None:
        answer = {"soc.json": replay.to_json().encode()}
        folder, _ = write_results(
            session, folder, answer, partial(_draw, replay, paper), output.force
        )
    if output.as_json:
        typer.echo(replay.to_json(), nl=False)
    session.show(soc_screen(replay))
    if folder is not None:
        session.show(["", f"  {folder}/soc.json   figures   {session.elapsed_s:.1f} s"])
    session.warn(as_flags(text) for text in replay.warnings)


def _draw(replay: "SocReplay", paper: bool) -> dict[str, bytes]:
    from ..plots import column_width, plot_soc_replay
    from ..plots.pictures import encode
    from ..reporting import paper_files
    from ..reporting.illustrations import Illustration

    files = {"figures/soc.png": encode(plot_soc_replay(replay), dpi=180)}
    if paper:
        with column_width():
            files |= paper_files([Illustration("soc", plot_soc_replay(replay), "", "")])
    return files
