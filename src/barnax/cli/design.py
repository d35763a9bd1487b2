"""`barnax design`: the next test of a cell."""

import shlex
from collections.abc import Collection, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from ..errors import InputError
from ..settings import WINDOW_OPTIONS, Over, choices_in
from .options import DATA, argument, group, option
from .output import Output
from .session import as_flags, flag_of, use_compilation_cache

if TYPE_CHECKING:
    from rich.console import RenderableType

    from ..experiment import Design
    from ..reopening import Places
    from ..results import Result

FOLDER = Path("barnax-design")
CELL, TEST, LIMITS = "Cell", "Test", "Limits"


@group
class Cell:
    """Knowledge of the cell."""

    result: Path | None = argument(
        "[RESULT]",
        "The folder that identify wrote, or its result.json: what it determines counts. "
        "Without it, --capacity and --chemistry are what is known.",
        None,
    )
    data: list[Path] | None = DATA
    capacity: float | None = option(CELL, "AH", "Capacity (default: the result's).")
    chemistry: str | None = option(
        CELL,
        "nmc|lfp",
        "Typical cell without a result (default: nmc), or beyond the SOC that it knows.",
    )


@group
class Test:
    """The aim of the test."""

    want: list[str] | None = option(
        TEST,
        "NAME=HALF",
        "Half the 95 % interval that is wanted from 10 to 90 % SOC, such as R0=2%, R1=10%, R2=10% "
        "or OCV=10mV, or the error on a drive cycle, drive=8mV; repeatable; hppc wants what an "
        "HPPC would tell.",
    )
    max_hours: float | None = option(
        TEST,
        "HOURS",
        "The longest that it may take (default: 3, and no test of what the result tells already).",
    )
    blocks: str | None = option(
        TEST, "NAME,NAME", "Only pieces whose names begin so, such as long,short,binary."
    )
    key: int = option(TEST, "N", "Random key of the random pieces.", 0)


@group
class Kept:
    """Limits that the test must keep."""

    low_voltage: float | None = option(LIMITS, "V", "Lowest voltage (default: the chemistry's).")
    high_voltage: float | None = option(LIMITS, "V", "Highest voltage.")
    max_discharge: str | None = option(
        LIMITS,
        "RATE",
        "Largest discharge in 1/h of the capacity, or over SOC as SOC=RATE,SOC=RATE (default: 1, "
        "with a result the largest of its records).",
    )
    max_charge: str | None = option(
        LIMITS, "RATE", "Largest charge, likewise (default: half of that)."
    )
    max_warming: float | None = option(
        LIMITS, "K", "How much the test may warm the cell in moving air (default: no limit)."
    )
    temperature: float | None = option(LIMITS, "DEGC", "Temperature of the test.")


def design(cell: Cell, test: Test, kept: Kept, output: Output) -> None:
    """Design the next test of a cell: the shortest that narrows its intervals to what is wanted.

    Writes the steps as CSV, as a profile, as a PyBaMM experiment and as text
    for a cycler's editor, with what they are predicted to tell.
    """
    given = [] if cell.result is None else [cell.result]
    session, folder = output.begun(FOLDER, given)
    with session.watch("Loading JAX"):
        use_compilation_cache()
        import jax

        from ..experiment import candidate_blocks
        from ..experiment import design as designed
        from ..experiment.belief import believed_of
        from ..experiment.protocol import drive_levels
        from ..reporting.design import design_screen, planned_lines
        from ..reporting.design_forms import design_files
        from ..results import Result

    blocks = None
    if test.blocks is not None:
        beginnings = tuple(name.strip() for name in test.blocks.split(","))
        usual = candidate_blocks(jax.random.key(test.key), drive_levels())
        blocks = [block for block in usual if block.name.startswith(beginnings)]
        for beginning in beginnings:
            if not beginning or not any(block.name.startswith(beginning) for block in usual):
                raise InputError(
                    f"`blocks` {beginning!r}: no piece is called so; there are "
                    f"{'; '.join(block.name for block in usual)}"
                )
    with session.watch("Looking at the records"):
        known = None if cell.result is None else Result.load(cell.result, data=cell.data or ())
        believed = believed_of(known, cell.capacity, cell.chemistry, kept.temperature)
    rates = {"max_discharge": kept.max_discharge, "max_charge": kept.max_charge}
    chosen = [name for name, rate in rates.items() if rate is not None]
    with session.watch("Designing"):
        found = designed(
            believed, max_hours=test.max_hours, want=_wanted(test.want), blocks=blocks,
            key=test.key, low_voltage=kept.low_voltage, high_voltage=kept.high_voltage,
            max_discharge=_rate("max_discharge", kept.max_discharge),
            max_charge=_rate("max_charge", kept.max_charge), max_warming=kept.max_warming,
            temperature=kept.temperature,
        )  # fmt: skip

    session.show(planned_lines(believed, as_flags, chosen))
    if not found.is_needed:
        # A folder that nobody asked for would hold no test.
        folder = output.out

    def files() -> dict[str, bytes]:
        if not found.is_needed:
            return {}
        from ..plots import plot_design
        from ..plots.pictures import encode

        return {**design_files(found), "figures/design.png": encode(plot_design(found))}

    session.show(design_screen(found, as_flags))
    folder, _ = output.deliver(session, folder, "design.json", found.to_json(), files)
    if folder is not None and not found.is_needed:
        session.show_written(folder, ["design.json"])
    elif folder is not None:
        names = ["steps.csv", "profile.csv", "experiment_pybamm.py", "procedure.txt", "figures"]
        session.show_written(folder, names)
        session.show(next_after(found, known, cell, folder))


def next_after(
    found: "Design", known: "Result | None", cell: Cell, folder: Path
) -> "list[RenderableType]":
    """The step after the test: to identify its record, with what counted and its options."""
    from ..reopening import Places, file_of
    from ..reporting.terminal import next_lines
    from ..reporting.words import joined

    soc, missing = f"{found.initial_soc:g}", []
    words = ["barnax", "identify"]
    if known is not None and cell.result is not None and found.earlier:
        replaced = [] if cell.capacity is None else ["capacity"]
        files, missing = _files_of(known, Places.of(cell.result, cell.data or ()), replaced)
        words += ["RECORD", *files]
        # Where nothing shows what is full, its rest tells where it starts on the others' OCV.
        words += [] if found.start_v else ["--initial-soc", f"RECORD={soc}"]
    else:
        words += ["RECORD", "--initial-soc", soc]
        tests = [] if known is None else known.of_role("ocv")
        names = dict.fromkeys(file_of(part.name) for part in tests)
        words += [word for name in names for word in ("--ocv", name)]
        words += [] if tests else ["--capacity", f"{found.capacity_ah:g}"]
    if cell.capacity is not None:
        words += ["--capacity", f"{cell.capacity:g}"]
    command = shlex.join([*words, "--design", str(folder)])
    advice = "run the test and identify its record"
    if missing:
        names = joined(list(dict.fromkeys(missing)))
        advice += f"; write the path of {names}: no file of that name and content was found"
    return [*next_lines(advice, command)]


def _files_of(
    known: "Result", places: "Places", replaced: Collection[str]
) -> tuple[list[str], list[str]]:
    """The stored records and OCV tests where they lie, with the circuit that was asked for and the
    options of the records but those `replaced`; and the names of the files that were not found."""
    from ..reopening import file_of

    words: list[str] = []
    missing: list[str] = []
    for role, before in (("identification", ()), ("ocv", ("--ocv",))):
        for name, sha256 in {file_of(p.name): p.sha256 for p in known.of_role(role)}.items():
            try:
                words += [*before, str(places.find(name, sha256))]
            except InputError:
                words += [*before, name]
                missing.append(name)
    if not known.tried:
        words += ["--model", known.model]
        words += ["--over", known.over] if known.over in choices_in(Over) else []
    common = known.common_window
    windows = {
        file_of(p.name): p.window.as_told for p in known.of_role("identification") if p.window
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
    found = {}
    for text in texts:
        name, _, value = text.partition("=")
        number, scale = value.strip(), 1.0
        is_voltage = name.strip() in ("OCV", "drive")
        for unit, worth in ({"mV": 1e-3, "V": 1.0} if is_voltage else {"%": 1e-2}).items():
            if number.endswith(unit):
                number, scale = number.removesuffix(unit), worth
                break
        try:
            found[name.strip()] = scale * float(number)
        except ValueError as problem:
            raise InputError(
                f"`want` {text!r}: write it like R0=2% or OCV=10mV, or hppc"
            ) from problem
    return found


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
