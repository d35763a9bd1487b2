"""The circuit of the family that was chosen, what was tried beside it, and the constant circuit."""

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

from .document import Bullets, Cells, Document, Section, Table, make_table
from .words import NOTHING, counted, fixed, joined, percent

if TYPE_CHECKING:
    from ..over_soc import SocErrors
    from ..results import Result
    from ..run import Candidate
    from ..select import Tried

# What a rung of the family adds.
ADDS = {
    "nodes": "more nodes",
    "pairs": "one more RC pair",
    "hysteresis": "a hysteresis",
    "switched": "a switched hysteresis",
    "law": "a law",
    "without": "rung taken back",
    None: "",
}


def ranked(candidates: "Sequence[Candidate]") -> "list[Candidate]":
    """The answer first."""
    return sorted(candidates, key=lambda candidate: not candidate.is_answer)


def candidates_section(
    candidates: "Sequence[Candidate]", tried: "Sequence[Tried]", validation: Sequence[str]
) -> list[Section]:
    """The answer and the constant circuit with their errors, and how the answer was chosen."""
    if len(candidates) < 2 and len(tried) < 2:
        return []
    rule = (
        "From the simplest circuit on, one rung at a time. A rung is kept if its gain over the "
        "circuit kept before exceeds 0.03 and 1.5 of its standard errors (a hysteresis 0.2, "
        "beside an OCV test), and no other rung of that round gained more (less gain). "
        "Not determined: its hysteresis turns within 1 % SOC, or the interval of its law spans "
        "more than a factor of ten."
    )
    table = candidates_table(candidates, validation)
    parts = (Bullets((rule,)), table, choice_table(tried)) if tried else (table,)
    return [Section("Circuits", parts)]


def choice_document(result: "Result") -> Document:
    """How the circuit of a result was chosen."""
    validation = [part.name for part in result.of_role("validation")]
    sections = candidates_section(result.candidates, result.tried, validation)
    return Document("How the circuit was chosen", "", tuple(sections))


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
        "RMSE in mV, in brackets that above 10 % SOC, of the answer"
        + (" and the constant circuit." if len(candidates) > 1 else "."),
        ranked(candidates),
        cells,
        ["circuit", "left out [mV]", "identification [mV]", "proved: better by at most", ""],
    )


def choice_table(tried: "Sequence[Tried]") -> Table:
    """Every circuit that was tried, in order, with what it gained on the one before."""

    def gain(own: "Tried") -> str:
        if own.gain is None:
            return NOTHING
        return f"{fixed(own.gain.value, 3)} ({fixed(own.gain.standard_error, 3)})"

    cells: Cells[Tried] = {
        "circuit": lambda own: own.circuit,
        "nodes": lambda own: str(own.nodes),
        "follows": lambda own: joined(own.follows) if own.follows else "",
        "adds": lambda own: ADDS[own.ladder],
        "fitted [mV]": lambda own: fixed(1e3 * own.rmse_v, 2),
        "held out [mV]": lambda own: errors_words(own.held_out),
        "gain (standard error)": gain,
        "": lambda own: own.outcome,
    }
    return make_table(
        "How the circuit was chosen: errors on held-out blocks, in brackets those above 10 % SOC, "
        "and the gain in the logarithm of the mean square.",
        tried,
        cells,
        ["circuit", "nodes", "adds", "held out [mV]", "gain (standard error)", ""],
    )


def choice_line(result: "Result") -> str:
    """How many circuits were tried, and how; empty where there was no choice."""
    if len(result.tried) < 2:
        return ""
    circuits = {(own.circuit, own.nodes, own.follows) for own in result.tried}
    kept = [own for own in result.tried if own.kept][-1]
    nodes = (
        f"{counted(kept.nodes, 'node')} over SOC" if kept.nodes > 1 else "one value at every SOC"
    )
    return f"{kept.circuit} with {nodes}, the best of {len(circuits)} tried on held-out blocks."


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


def ocv_test_sentences(result: "Result") -> Iterator[str]:
    """How far the OCV test is from an OCV of the records' own."""
    own = result.fit.own_ocv
    # The OCV of a pulse test is already the records' own.
    if own is None or is_pulse_test(result):
        return
    yield (
        f"an OCV of the records' own is {1e3 * own.median_v:.2g} mV from it (median), "
        f"{1e3 * own.largest_v:+.0f} mV at {percent(own.largest_soc)} SOC."
    )
