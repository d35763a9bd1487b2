"""`barnax design`: the next test of a cell."""

import shlex
from collections.abc import Collection, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import barnax

from .. import reporting
from ..errors import InputError
from ..notices import Notice
from ..settings import WINDOW_OPTIONS, Over, choices_in
from .options import group
from .output import Output
from .session import flag_of

if TYPE_CHECKING:
    from rich.console import RenderableType

    from ..reopening import StoredInputs


@group
class Cell:
    """Knowledge of the cell.

    Arguments:
        result ([RESULT]): The folder that identify wrote, or its result.json: what it determines
            counts. Without it, --capacity and --chemistry are what is known.

    Cell:
        capacity (AH): Capacity (default: the result's).
        chemistry (nmc|lfp): Typical cell without a result (default: nmc), or beyond the SOC that it
            knows.
    """

    result: Path | None = None
    data: list[Path] | None = None
    capacity: float | None = None
    chemistry: str | None = None


@group
class Test:
    """The aim of the test, and the limits that it must keep.

    Test:
        want (NAME=HALF): Half the 95 % interval that is wanted from 10 to 90 % SOC, such as R0=2%,
            R1=10%, R2=10% or OCV=10mV, or the error on a drive cycle, drive=8mV; repeatable; hppc
            wants what an HPPC would tell.
        max_hours (HOURS): The longest that it may take (default: 3, and no test of what the result
            tells already).
        blocks (NAME,NAME): Only pieces whose names begin so, such as long,short,binary.
        key (N): Random key of the random pieces.

    Limits:
        low_voltage (V): Lowest voltage (default: the chemistry's).
        high_voltage (V): Highest voltage.
        max_discharge (RATE): Largest discharge in 1/h of the capacity, or over SOC as
            SOC=RATE,SOC=RATE (default: 1, with a result the largest of its records).
        max_charge (RATE): Largest charge, likewise (default: half of that).
        max_warming (K): How much the test may warm the cell in moving air (default: no limit).
        temperature (DEGC): Temperature of the test.
    """

    want: list[str] | None = None
    max_hours: float | None = None
    blocks: str | None = None
    key: int = 0
    low_voltage: float | None = None
    high_voltage: float | None = None
    max_discharge: str | None = None
    max_charge: str | None = None
    max_warming: float | None = None
    temperature: float | None = None


def design(cell: Cell, test: Test, output: Output) -> None:
    """Design the next test of a cell: the shortest that narrows its intervals to what is wanted.

    Writes the steps as CSV, as a profile, as a PyBaMM experiment and as text
    for a cycler's editor, with what they are predicted to tell.
    """
    run = output.begun("barnax-design", [] if cell.result is None else [cell.result])
    run.load_jax()
    from ..experiment.belief import believed_of

    blocks = None if test.blocks is None else _blocks(test.blocks, test.key)
    with run.watch("Looking at the records"):
        stored = (
            None if cell.result is None else barnax.Result.load(cell.result, data=cell.data or ())
        )
        believed = believed_of(stored, cell.capacity, cell.chemistry, test.temperature)
    rates = {name: _rate(name, vars(test)[name]) for name in ("max_discharge", "max_charge")}
    with run.watch("Designing"):
        asked: dict[str, Any] = {**vars(test), **rates}
        asked |= {"want": _wanted(test.want), "blocks": blocks}
        test_design = barnax.design(believed, **asked)
    chosen = [name for name, rate in rates.items() if rate is not None]
    run.show_document(reporting.design.planned_screen(believed, chosen))
    run.show_document(reporting.design.design_screen(test_design))
    if not test_design.is_needed:
        # A folder that nobody asked for would hold no test.
        run.folder = output.out
        run.deliver("design.json", test_design.to_json(), dict)
        return run.show_written(["design.json"])

    def files() -> dict[str, bytes]:
        files = reporting.design_forms.design_files(test_design)
        return files | {"figures/design.png": barnax.plots.encode(test_design.figure())}

    run.deliver("design.json", test_design.to_json(), files)
    if run.folder is not None:
        names = ["steps.csv", "profile.csv", "experiment_pybamm.py", "procedure.txt", "figures"]
        run.show_written(names)
        run.show(next_after(test_design, stored, cell, run.folder))


def _blocks(text: str, key: int) -> "list[barnax.Block]":
    """The usual pieces whose names begin as one of several texts."""
    import jax

    from ..experiment.protocol import drive_levels

    usual = barnax.candidate_blocks(jax.random.key(key), drive_levels())
    beginnings = tuple(name.strip() for name in text.split(","))
    for beginning in beginnings:
        if not beginning or not any(block.name.startswith(beginning) for block in usual):
            names = "; ".join(block.name for block in usual)
            raise InputError(f"`blocks` {beginning!r}: no piece is called so; there are {names}")
    return [block for block in usual if block.name.startswith(beginnings)]


def next_after(
    test: "barnax.Design", stored: "barnax.Result | None", cell: Cell, folder: Path
) -> "list[RenderableType]":
    """The step after the test: to identify its record, with what counted and its options."""
    from ..reopening import StoredInputs, file_of
    from ..reporting.terminal import next_lines
    from ..reporting.words import joined

    soc, missing = f"{test.initial_soc:g}", []
    words = ["barnax", "identify"]
    if stored is not None and cell.result is not None and test.earlier:
        replaced = [] if cell.capacity is None else ["capacity"]
        files, missing = _files_of(stored, StoredInputs.of(cell.result, cell.data or ()), replaced)
        words += ["RECORD", *files]
        # Where nothing shows what is full, its rest tells where it starts on the others' OCV.
        words += [] if test.start_v else ["--initial-soc", f"RECORD={soc}"]
    else:
        words += ["RECORD", "--initial-soc", soc]
        tests = [] if stored is None else stored.of_role("ocv")
        names = dict.fromkeys(file_of(part.name) for part in tests)
        words += [word for name in names for word in ("--ocv", name)]
        words += [] if tests else ["--capacity", f"{test.capacity_ah:g}"]
    if cell.capacity is not None:
        words += ["--capacity", f"{cell.capacity:g}"]
    command = shlex.join([*words, "--design", str(folder)])
    advice = "run the test and identify its record"
    if missing:
        names = joined(list(dict.fromkeys(missing)))
        advice += f"; write the path of {names}: no file of that name and content was found"
    return [*next_lines(advice, command)]


def _files_of(
    stored: "barnax.Result", places: "StoredInputs", replaced: Collection[str]
) -> tuple[list[str], list[str]]:
    """The stored records and OCV tests where they lie, with the circuit that was asked for and the
    options of the records but those `replaced`; and the names of the files that were not found."""
    from ..reopening import file_of

    words: list[str] = []
    missing: list[str] = []
    for role, before in (("identification", ()), ("ocv", ("--ocv",))):
        for name, sha256 in {file_of(p.name): p.sha256 for p in stored.of_role(role)}.items():
            found = places.find(name, sha256)
            missing += [name] if isinstance(found, Notice) else []
            words += [*before, name if isinstance(found, Notice) else str(found)]
    if not stored.tried:
        words += ["--model", stored.model]
        words += ["--over", stored.over] if stored.over in choices_in(Over) else []
    common = stored.common_window
    windows = {
        file_of(p.name): p.window.as_told for p in stored.of_role("identification") if p.window
    }
    for asked, (name, *_) in WINDOW_OPTIONS.items():
        shared = getattr(common, name)
        values = {f"{file}=": getattr(window, name) for file, window in windows.items()}
        for of, value in ({"": shared} if shared is not None else values).items():
            if value is not None and asked not in replaced:
                text = ",".join(map(str, value)) if isinstance(value, tuple) else str(value)
                words += [flag_of(asked), f"{of}{text}"]
    return words, missing


def _wanted(texts: Sequence[str] | None) -> dict[str, float] | Literal["hppc"] | None:
    """Wishes such as R0=2% or OCV=10mV."""
    if not texts:
        return None
    if texts == ["hppc"]:
        return "hppc"
    wanted = {}
    for text in texts:
        name, _, value = (part.strip() for part in text.partition("="))
        scales = {"mV": 1e-3, "V": 1.0} if name in ("OCV", "drive") else {"%": 1e-2}
        unit = next((unit for unit in scales if value.endswith(unit)), "")
        try:
            wanted[name] = scales.get(unit, 1.0) * float(value.removesuffix(unit))
        except ValueError as problem:
            words = "write it like R0=2% or OCV=10mV, or hppc"
            raise InputError(f"`want` {text!r}: {words}") from problem
    return wanted


def _rate(name: str, text: str | None) -> float | list[tuple[float, float]] | None:
    """A rate, or pairs of SOC and rate."""
    if text is None:
        return None
    try:
        if "=" not in text:
            return float(text)
        pairs = (pair.split("=") for pair in text.split(","))
        return [(float(soc), float(rate)) for soc, rate in pairs]
    except ValueError as problem:
        raise InputError(
            f"`{name}` {text!r}: write a rate like 1.5, or rates over SOC like 0=0.5,0.8=1,1=0.2"
        ) from problem
