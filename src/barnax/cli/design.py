"""`barnax design`: the next test of a cell."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

import barnax

from .. import reporting
from ..errors import InputError
from ..settings import Window
from .output import PLAN, Output, new_run

# The record of a designed test, next to its plan.
RECORD = "record.csv"


def design(
    *,
    result: Path | None = None,
    data: list[Path] | None = None,
    capacity: float | None = None,
    chemistry: str | None = None,
    want: list[str] | None = None,
    max_hours: float | None = None,
    low_voltage: float | None = None,
    high_voltage: float | None = None,
    max_discharge: str | None = None,
    max_charge: str | None = None,
    max_warming: float | None = None,
    temperature: float | None = None,
    output: Output,
) -> None:
    """Design the next test of a cell.

    The test is the shortest that narrows the intervals to what is wanted. Writes
    the steps as CSV, as a profile, as a PyBaMM experiment and as text for a
    cycler's editor, with the intervals that they are predicted to reach.

    Arguments:
        result ([RESULT]): The folder that identify wrote, or its result.json: what it determines
            counts. Without it, --capacity and --chemistry say what the cell is.

    Cell:
        capacity (AH): Capacity (default: the result's).
        chemistry (nmc|lfp): Typical cell to assume without a result (default: nmc), and at SOC that
            its records do not cover.

    Test:
        want (NAME=HALF): Half-width of the 95 % interval to reach from 10 to 90 % SOC, such as
            R0=2%, R1=10%, R2=10% or OCV=10mV, or the error on a drive cycle, drive=8mV; repeatable;
            hppc asks for what an HPPC would determine.
        max_hours (HOURS): Longest duration of the test (default: 3, without testing what the
            result determines already).

    Limits:
        low_voltage (V): Lowest voltage (default: the chemistry's).
        high_voltage (V): Highest voltage.
        max_discharge (RATE): Largest discharge in 1/h of the capacity, or over SOC as
            SOC=RATE,SOC=RATE (default: 1, with a result the largest of its records).
        max_charge (RATE): Largest charge, likewise (default: half of that).
        max_warming (K): Largest temperature rise of the cell in moving air (default: no limit).
        temperature (DEGC): Temperature of the test.
    """
    run = output.begun("barnax-design", *filter(None, [result]))
    from ..experiment.prior import prior_of

    with run.watch("Looking at the records"):
        stored = None if result is None else barnax.Result.load(result, data=data or ())
        earlier = _earlier(result)
        prior = prior_of(stored, capacity, chemistry, temperature)
    given = {"max_discharge": max_discharge, "max_charge": max_charge}
    rates = {name: _rate(name, text) for name, text in given.items() if text is not None}
    limits: dict[str, Any] = {"low_voltage": low_voltage, "high_voltage": high_voltage, **rates}
    limits |= {"max_hours": max_hours, "max_warming": max_warming, "temperature": temperature}
    with run.watch("Designing"):
        test_design = barnax.design(prior, want=_wanted(want), **limits)
    run.show_document(reporting.design.planned_screen(prior, list(rates)))
    run.show_document(reporting.design.design_screen(test_design))
    if not test_design.is_needed:
        # An automatic folder would contain no test.
        run.folder = output.out
        run.deliver({"design.json": test_design.to_json()}, dict)
        return run.show_written(["design.json"])

    def files() -> dict[str, bytes]:
        files = reporting.design_forms.design_files(test_design)
        return files | {"figures/design.png": barnax.plots.encode(test_design.figure())}

    plan = barnax.plan_to_toml(plan_after(test_design, earlier, capacity))
    run.deliver({"design.json": test_design.to_json(), PLAN: plan}, files)
    if run.folder is not None:
        names = ["steps.csv", "profile.csv", "experiment_pybamm.py", "procedure.txt", "figures"]
        run.show_written(names)
        run.show([reporting.terminal.next_step(*_next(test_design, earlier, run.folder))])


def _earlier(result: Path | None) -> "barnax.Plan":
    """The records and OCV tests of the plan next to a result, by their full paths; each pulse test
    without an OCV test is one too."""
    from ..plan import Plan, plan_from_toml, with_whole_paths
    from ..reopening import StoredInputs

    beside = None if result is None else StoredInputs.of(result).plan
    if beside is None or not beside.is_file():
        return Plan("identify", ())
    plan = with_whole_paths(plan_from_toml(beside), ())
    tests = plan.of_role("OCV test")
    if plan.command == "hppc" and not tests:
        tests = [replace(part, role="OCV test") for part in plan.of_role("identification")]
    # Each record's window includes the common one, and the next record starts elsewhere.
    common = plan.window
    common = Window(temperature_degc=common.temperature_degc, rest_current_a=common.rest_current_a)
    parts = *plan.of_role("identification"), *tests
    return replace(plan, command="identify", parts=parts, window=common)


def plan_after(
    test: "barnax.Design", earlier: "barnax.Plan", capacity_ah: float | None
) -> "barnax.Plan":
    """The plan that identifies the record of the test, `RECORD` next to it, with the previous
    records.

    If nothing shows when the cell is full, the record starts where its rest fits the others' OCV.
    """
    from ..plan import FileRole

    counted = [part for part in earlier.parts if test.earlier or part.role == "OCV test"]
    is_open = bool(counted and test.earlier and test.start_v)
    start = Window(initial_soc=None if is_open else test.initial_soc)
    designed = FileRole(path=Path(RECORD), name=RECORD, role="identification", window=start)
    if capacity_ah is None and not counted:
        capacity_ah = test.capacity_ah
    return replace(earlier, parts=(designed, *counted)).changed(None, capacity=capacity_ah)


def _next(test: "barnax.Design", earlier: "barnax.Plan", folder: Path) -> tuple[str, str]:
    """What to do after the test, and the command for it."""
    advice = f"run the test and save its record as {folder / RECORD}"
    unplanned = [name for name in test.earlier if not earlier.parts]
    if unplanned:
        names = reporting.words.joined(unplanned)
        advice += f"; add {names} to its {PLAN}, for none is beside the result"
    return advice, new_run(str(folder / PLAN), "--design", str(folder))


def _wanted(texts: Sequence[str] | None) -> dict[str, float] | Literal["hppc"] | None:
    """Targets such as R0=2% or OCV=10mV."""
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


def _rate(name: str, text: str) -> float | list[tuple[float, float]]:
    """A rate, or pairs of SOC and rate."""
    try:
        if "=" not in text:
            return float(text)
        pairs = (pair.split("=") for pair in text.split(","))
        return [(float(soc), float(rate)) for soc, rate in pairs]
    except ValueError as problem:
        raise InputError(
            f"`{name}` {text!r}: write a rate like 1.5, or rates over SOC like 0=0.5,0.8=1,1=0.2"
        ) from problem
