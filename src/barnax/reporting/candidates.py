"""The circuits that were weighed against each other, and tables against the constant one."""

import math
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

from ..checks.roles import are_unfit
from .document import Bullets, Cells, Section, Table, make_table
from .words import NOTHING, fixed, millivolt, percent

if TYPE_CHECKING:
    from ..candidates import Candidate
    from ..over_soc import SocErrors, TableFit
    from ..result_parts import MetricsPart
    from ..results import Result

    # The errors of a constant circuit, and of the tables beside it.
    Both = tuple[SocErrors, SocErrors]

# Errors on a whole record that differ by less than this share count as equal.
ALIKE = 0.02


def ranked(candidates: "Sequence[Candidate]") -> "list[Candidate]":
    """The answer first, then by the errors on what was fitted."""
    return sorted(
        candidates, key=lambda candidate: (not candidate.is_answer, candidate.identification.rmse_v)
    )


def candidates_section(
    candidates: "Sequence[Candidate]", validation: Sequence[str]
) -> list[Section]:
    """Every circuit that was weighed with its errors, the answer marked; none for a single one."""
    if len(candidates) < 2:
        return []
    told = (
        "Each is the best circuit of its kind that was found; how much better another of its kind "
        "could be is proved for some. What is left out of the fit, blocks of one record or each of "
        "several records, decides which is the answer: the simplest circuit, unless another "
        "lowers that error, and that above 10 % SOC, by more than 10 %; but a `model` or `over` "
        "that was given is the answer in any case."
    )
    return [Section("Circuits", (Bullets((told,)), candidates_table(candidates, validation)))]


def candidates_table(candidates: "Sequence[Candidate]", validation: Sequence[str]) -> Table:
    """The errors of every circuit on all records."""
    cells: Cells[Candidate] = {
        "circuit": lambda candidate: candidate.name,
        "identification [mV]": lambda candidate: errors_words(candidate.identification),
    }
    for place, name in enumerate(validation):
        cells[f"{name} [mV]"] = lambda candidate, place=place: fixed(
            1e3 * candidate.validation_v[place], 1
        )
    cells["left out [mV]"] = lambda candidate: errors_words(candidate.held_out)
    cells["proved: better by at most"] = lambda candidate: (
        "not proved"
        if candidate.proved_gap is None or candidate.proved_gap >= 1
        else percent(candidate.proved_gap)
    )
    cells[""] = lambda candidate: "the answer" if candidate.is_answer else ""
    return make_table(
        "RMSE in mV, in brackets that above 10 % SOC, of the circuits that were compared.",
        ranked(candidates),
        cells,
        ["circuit", "left out [mV]", "identification [mV]", "proved: better by at most", ""],
    )


def pay_sentence(
    unseen: "Both | None",
    held: "Both | None",
    constant: str,
    tables: str,
    held_out: str = "held-out blocks",
    remedy: str = "",
) -> str:
    """A verdict on tables beside the best constant circuit, both named; empty where nothing was
    held out and there is no other record.

    `unseen` are the errors on the validation records, which decide where there are any; else
    `held`, those on what was held out of the fit, do: `held_out` says what that is. `remedy` is
    what to do where tables do not help.
    """
    told, pays = [], tables_pay(unseen, held)
    if unseen is not None:
        told.append(f"{_change(*unseen)} on the validation records")
    if held is not None:
        is_alike = (held[1].rmse_v < held[0].rmse_v) == pays
        joint = "" if not told else ", and from " if is_alike else ", but from "
        told.append(f"{joint}{_change(*held)} on {held_out}")
    if not told:
        return ""
    change = f"RMSE from {''.join(told)}, from constant {constant} to tables of {tables}"
    if pays and unseen is not None and unseen[1].rmse_v >= unseen[0].rmse_v:
        return f"tables help above 10 % SOC: {change}."
    if pays:
        return f"tables lower the {change}."
    shown = unseen or held
    if shown and shown[1].rmse_v < (1 - ALIKE) * shown[0].rmse_v:
        return f"tables help below 10 % SOC only: {change}."
    return f"tables do not help: {change}.{remedy}"


def tables_pay(unseen: "Both | None", held: "Both | None") -> bool:
    """True if tables are better where they were not fitted, as `pay_sentence` says it."""
    if unseen is None:
        return held is not None and held[1].is_worth(held[0])
    constant, tables = unseen
    if constant.above_v is None or tables.above_v is None:
        return tables.rmse_v < constant.rmse_v
    if abs(tables.rmse_v / constant.rmse_v - 1) > ALIKE:
        return tables.rmse_v < constant.rmse_v
    # Both may fail when nearly empty; the error above that decides.
    return tables.above_v < constant.above_v


def held_out_errors(result: "Result") -> "Both | None":
    """The constant circuit's errors and the tables' on held-out blocks; None where either has none.

    What was cross-validated beside the tables is the constant circuit of the same name, which need
    not be the best one.
    """
    of = {(candidate.model, candidate.over): candidate.held_out for candidate in result.candidates}
    tables = both_held_out(result.fit)
    constant = of.get((result.constant.model, None))
    if tables is not None and constant is None and result.constant.model == result.model:
        return tables
    return None if tables is None or constant is None else (constant, tables[1])


def held_out_words(fit: "TableFit") -> str:
    """A name for the samples that were held out of a fit."""
    held = fit.cross_validation
    return "records left out in turn" if held and held.by_record else "held-out blocks"


def both_held_out(fit: "TableFit") -> "Both | None":
    """The errors on held-out blocks: of a constant circuit with the tables' pairs, and theirs."""
    held = fit.cross_validation
    return None if held is None else (held.constant, held.tables)


def unseen_errors(result: "Result") -> "Both | None":
    """The constant circuit's errors and the tables' over all validation records, if any: root mean
    squares, each record counting alike."""
    from ..over_soc import SocErrors

    def root_mean_square(values: list[float]) -> float:
        return math.sqrt(sum(value**2 for value in values) / len(values))

    def over_all(parts: "Sequence[MetricsPart]") -> SocErrors:
        above_v = [part.rmse_above_10_soc_v for part in parts]
        known_v = [value_v for value_v in above_v if value_v is not None]
        return SocErrors(
            root_mean_square([part.rmse_v for part in parts]),
            root_mean_square(known_v) if len(known_v) == len(above_v) else None,
        )

    if result.tables is None or not result.metrics.validation:
        return None
    return over_all(result.constant.metrics.validation), over_all(result.metrics.validation)


def _change(constant: "SocErrors", tables: "SocErrors") -> str:
    """From the constant circuit's error to the tables'."""
    change = f"{fixed(1e3 * constant.rmse_v, 1)} to {fixed(1e3 * tables.rmse_v, 1)} mV"
    if tables.above_v is not None and constant.above_v is not None:
        above = (fixed(1e3 * value_v, 1) for value_v in (constant.above_v, tables.above_v))
        change += f" ({' to '.join(above)} above 10 % SOC)"
    return change


def errors_words(errors: "SocErrors | None") -> str:
    """An RMSE in mV, in brackets that above 10 % SOC; a dash where there is none."""
    if errors is None:
        return NOTHING
    above = "" if errors.above_v is None else f" ({fixed(1e3 * errors.above_v, 1)})"
    return f"{fixed(1e3 * errors.rmse_v, 1)}{above}"


def is_pulse_test(result: "Result") -> bool:
    """True where what was identified on is the OCV test too."""
    tests = {part.sha256 for part in result.of_role("ocv")}
    return not tests.isdisjoint(part.sha256 for part in result.of_role("identification"))


def ocv_test_sentences(result: "Result", is_short: bool = False) -> Iterator[str]:
    """The worth of an OCV test: errors with the records' own OCV in its place."""
    own, held = result.fit.own_ocv, both_held_out(result.fit)
    # The OCV of a pulse test is already the records' own.
    if own is None or is_pulse_test(result):
        return
    left = worth = ""
    if own.held_out is not None and held is not None:
        left = f", {millivolt(own.held_out.rmse_v)} left out"
        if own.held_out.above_v is not None:
            left += f" ({millivolt(own.held_out.above_v)} above 10 % SOC)"
        names = {part.name for part in result.of_role("identification")}
        # Records of too few steps tell no OCV.
        if own.held_out.is_worth(held[1]) and not are_unfit(names, result.warnings, by_steps=True):
            # Of a folder, the plan chose the test.
            how = "the records alone, in place of their folder" if result.plan else "without `ocv`"
            worth = f"; that predicts better: try {how}"
    if is_short:
        yield f"without it {millivolt(own.own_v)}{left}{worth}."
        return
    yield (
        f"with an OCV of the records' own in its place {millivolt(own.own_v)}{left}; they are "
        f"{1e3 * own.median_v:.2g} mV apart (median), {1e3 * own.largest_v:+.0f} mV at "
        f"{percent(own.largest_soc)} SOC{worth}."
    )
