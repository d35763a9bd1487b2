"""What commands that identify read: records, OCV tests, a window and a box."""

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from ..bundled import BUNDLED
from ..errors import InputError
from .options import Hold, HysteresisFit, OcvFit, Sign, parse_steps
from .session import Session

if TYPE_CHECKING:
    from ..cell import CellModel
    from ..model.inputs import Window
    from ..records import Record


class Files(NamedTuple):
    """The files of a command, and the signs of current they are read with."""

    records: list[Path]
    ocv: list[Path]
    validation: list[Path]
    sign: Sign
    ocv_sign: Sign
    validation_sign: Sign
    hold: Hold

    @property
    def names(self) -> dict[Path, str]:
        """What each is called in results: the file's name, and folders where names are shared."""
        paths = {*self.records, *self.ocv, *self.validation}
        return {path: _shortest_own_name(path, paths - {path}) for path in paths}


def _shortest_own_name(path: Path, others: set[Path]) -> str:
    parts = path.absolute().parts
    for count in range(1, len(parts)):
        if all(other.absolute().parts[-count:] != parts[-count:] for other in others):
            return "/".join(parts[-count:])
    return path.name


class Inputs(NamedTuple):
    """What was in the files."""

    records: "list[Record]"
    tests: "list[Record]"
    validation: "list[Record]"
    cell: "CellModel"

    @property
    def hashes(self) -> list[str]:
        """What tells these files from any others."""
        return [record.sha256 for record in (*self.records, *self.tests, *self.validation)]


class Box(NamedTuple):
    """The user's changes to the search box, and where they came from, in words."""

    ranges: dict[str, tuple[float, float]]
    fixed: dict[str, float]
    source: str


def choose_files(
    records: list[Path], ocv: list[Path], validation: list[Path]
) -> tuple[list[Path], list[Path], list[Path]]:
    """The files to work on: those given, or the bundled cell's where none is."""
    if not records:
        if ocv or validation:
            raise InputError("give a RECORD to identify on; --ocv and --validate only go with one")
        return [BUNDLED.record], [*BUNDLED.ocv], [BUNDLED.validation]
    if not ocv:
        raise InputError(
            f"{records[0]}: an OCV test of the same cell is needed as well; give it with --ocv"
        )
    return records, ocv, validation


def read_inputs(
    session: Session,
    files: Files,
    *,
    capacity: float | None,
    ocv_fit: OcvFit,
    hysteresis_fit: HysteresisFit,
    rest_current: float | None,
) -> Inputs:
    """Every record, and the cell that the OCV tests show."""
    from ..cell import characterize
    from ..records import read_record

    names = files.names
    with session.stage("Reading records"):

        def read(path: Path, sign: Sign) -> "Record":
            record = read_record(path, current_sign=sign, current_hold=files.hold)
            return replace(record, name=names[path])

        tests = [read(path, files.ocv_sign) for path in files.ocv]
        dynamic = [read(path, files.sign) for path in files.records]
        others = [read(path, files.validation_sign) for path in files.validation]
    with session.stage("Characterizing the cell"):
        cell = characterize(
            tests,
            capacity_ah=capacity,
            ocv_fit=ocv_fit,
            hysteresis_fit=hysteresis_fit,
            rest_current_a=rest_current,
        )
    return Inputs(dynamic, tests, others, cell)


def make_window(
    *,
    start_time: float | None,
    start_after_step: int | None,
    initial_soc: float | None,
    score_steps: str | None,
    score_from: float | None,
    score_to: float | None,
    rest_current: float | None,
    initial_direction: int | None,
) -> "Window":
    """The window of the options. Raises `InputError` where they contradict each other."""
    from ..model.inputs import Window

    return Window(
        start_time_s=start_time,
        start_after_step=start_after_step,
        initial_soc=initial_soc,
        score_steps=parse_steps(score_steps),
        score_from_s=score_from,
        score_to_s=score_to,
        rest_current_a=rest_current,
        initial_direction=1 if initial_direction is None else initial_direction,
    )


def read_box(bounds: Path | None, fix: list[str] | None) -> Box:
    """The user's bounds and fixed values. Raises `InputError` where they cannot be read."""
    from ..model.search_space import parse_fixed, read_bounds

    ranges = read_bounds(bounds) if bounds is not None else {}
    source = bounds.name if bounds is not None else "--fix"
    return Box(ranges, parse_fixed(fix or []), source)
