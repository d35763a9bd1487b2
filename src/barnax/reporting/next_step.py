"""The most useful next step after a result."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, NamedTuple

from ..cell.circuits import Circuit, get_circuit
from ..cell.curves import MISS_TOLERANCE_V, PolynomialCurve
from ..cell.elements import alike
from ..cell.model import SAME_DEGC
from ..cell.soc_axis import ABOVE_SOC
from ..checks.roles import are_unfit
from ..plan.choosing import MAKE_RECORD
from ..settings import OVER_TEMPERATURE
from .view import View
from .words import joined, millivolt, percent, symbol

if TYPE_CHECKING:
    from ..cell import CellModel
    from ..results import Result

# What was not used is predicted badly where its error exceeds this multiple of the fit's, and this
# size; and as well as can be where it is under that: no table left open matters then.
LOST, LOST_V, FOUND_V = 2.0, 0.01, 0.002
# A table needs a test where less than `FEW` of its nodes have a relative error under `WIDE`.
WIDE, FEW = 0.5, 1 / 3


def _no_circuit(result: "Result") -> str:
    """Why the answer cannot be the cell's, empty where it may be."""
    upper = [bound.name for bound in result.constant.at_bound if bound.side == "upper"]
    at_bound = [symbol(name) for name in upper if name.endswith("[Ohm]")]
    if len(at_bound) > 1:
        return f"{joined(at_bound)} end at their upper bounds"
    worse = result.constant.metrics.identification.r2 < 0
    return "a constant voltage would fit as well" if worse else ""


@dataclass(frozen=True)
class Next:
    """The next step: options to run again with, an export of this result to a format,
    or a test designed from it."""

    advice: str
    options: Mapping[str, str] = field(default_factory=dict)
    exports: str = ""
    designs: bool = False


def next_step(result: "Result") -> Next:
    """The most useful next step.

    First what is plainly amiss: an OCV that misses its points, a circuit that cannot be the cell's,
    records that are not suitable, an OCV test that disagrees with them, records at other
    temperatures that are left over.
    Then the error on what was not used decides (`Unseen`):

    - over `LOST` times the error on what was fitted, and over `LOST_V`: more data;
    - known of no other record: validate on one;
    - over `FOUND_V`, and a resistance is left open at most nodes: a test that tells it;
    - else the circuit serves: export it to a format that holds its hysteresis.

    For a constant circuit there is more to try in place of the last two.
    """
    missed_v = _missed_by_the_polynomial_v(result.cell)
    if missed_v > MISS_TOLERANCE_V:
        missed = millivolt(missed_v)
        what = f"interpolate the OCV; the polynomial misses its points by up to {missed}"
        return Next(what, {"ocv_fit": "interpolated"})
    if result.tables is None and (reason := _no_circuit(result)):
        return Next(f"check the OCV test, `capacity`, the window and `bounds`: {reason}")
    names = {part.name for part in result.of_role("identification")}
    disagrees = any(warning.code == "ocv-test.disagrees" for warning in result.warnings)
    if are_unfit(names, result.warnings, by_steps=disagrees):
        return Next(
            f"{MAKE_RECORD}; {joined(sorted(names))} {'is' if len(names) == 1 else 'are'} not "
            "suitable for identification"
        )
    if disagrees:
        what = "see what the records tell without the OCV test, which disagrees with them"
        return Next(what)
    others = _other_temperatures(result)
    if others and result.tables is not None:
        where = joined([f"{degc:.3g}" for degc in others])
        what = f"for tables over temperature too, with the records at {where} degC"
        return Next(what, {"over": OVER_TEMPERATURE})
    unseen = Unseen.of(result)
    if unseen and (told := _more_data(result, unseen)):
        return Next(told)
    crossed = result.fit.cross_validation
    is_tried = bool(result.metrics.validation or (crossed and crossed.by_record))
    if not is_tried:
        return Next("validate on another record of the cell, with `validate`")
    wide = _wide(result)
    if wide and unseen and unseen.error_v > FOUND_V:
        return Next(f"measure what is missing: {wide}", designs=True)
    if result.tables is not None:
        what, to = _export(get_circuit(result.model))
        lost = any(fit.tables.dependence is not None for fit in result.fits)
        without = ", which has resistances over SOC alone" if lost else ""
        return Next(f"export the tables, for example {what}{without}", exports=to)
    elements = get_circuit(result.model).elements
    if not result.tried and alike(elements) < len(elements):
        return Next("try tables over SOC of this circuit too", {"over": "soc"})
    if not result.tried:
        return Next("try tables over SOC too, without `model`")
    found = result.constant.assessment
    if found is None:
        return Next("compute intervals of the parameters", {"trust": "basic"})
    names = [part.name for part in result.of_role("validation")]
    return Next(f"compare circuits and methods with barnax compare; validated on {joined(names)}")


class Unseen(NamedTuple):
    """What was not used: the worst record to validate on, else what was left out of the fit.

    `error_v` is its error, `fitted_v` that on what was fitted: both above 10 % SOC, for no circuit
    follows a discharge to its end, or both of all samples, with the start of the record moved to
    where that is less or where the other is not known. `where` says which.
    """

    error_v: float
    fitted_v: float
    name: str
    where: str

    @classmethod
    def of(cls, result: "Result") -> "Unseen | None":
        """None where there is neither."""
        own = result.metrics.identification

        def least(name: str, above_v: float | None, all_v: float, how: str = "") -> Unseen:
            found = cls(all_v, own.rmse_v, name, how)
            if above_v is None or own.rmse_above_10_soc_v is None:
                return found
            where = f"above {percent(ABOVE_SOC)} SOC "
            return min(cls(above_v, own.rmse_above_10_soc_v, name, where), found)

        others = [
            least(part.record, part.rmse_above_10_soc_v, moved_v or part.rmse_v, how)
            for part in result.metrics.validation
            for moved_v in [part.registered_v]
            for how in ["with its start moved, " if moved_v and moved_v < part.rmse_v else ""]
        ]
        if others:
            return max(others)
        crossed = result.fit.cross_validation
        if crossed is None:
            return None
        name = f"{'records' if crossed.by_record else 'blocks'} left out"
        return least(name, crossed.whole.above_v, crossed.whole.rmse_v)


def _more_data(result: "Result", unseen: Unseen) -> str:
    """Advice on more data where what was not used is predicted badly; empty where it is not."""
    if unseen.error_v < max(LOST * unseen.fitted_v, LOST_V):
        return ""
    use = "identify on another record too, one that loads the cell at every SOC"
    if View(result).is_pulse_test:
        use = (
            "identify on a record that loads the cell at every SOC, such as a drive cycle, with "
            "this test as `ocv`"
        )
    elif result.metrics.validation:
        use = f"identify on {unseen.name} too, or on another test"
    left, fitted = millivolt(unseen.error_v), millivolt(unseen.fitted_v)
    return f"{use}: {unseen.where}the error on {unseen.name} is {left}, on what was fitted {fitted}"


def _export(circuit: Circuit) -> tuple[str, str]:
    """A format that holds a circuit's hysteresis, in words and as `export` calls it."""
    if circuit.turning is not None:
        return "as a filter in C", "c-filter"
    return ("as CSV", "csv") if circuit.has_hysteresis else ("to PyBaMM", "pybamm")


def _wide(result: "Result") -> str:
    """A table that the data leave open nearly everywhere; empty where there is none."""
    if result.over in (None, OVER_TEMPERATURE):
        return ""
    for name in result.fit.tables.tables:
        nodes = result.fit.of_table(name)
        if not name.startswith("R") or not nodes:
            continue
        known = sum(n.low is not None and n.standard_error <= WIDE * n.value for n in nodes)
        if known < FEW * len(nodes):
            held = f"{known} of {len(nodes)} nodes"
            return f"the standard error of {symbol(name)} is under {percent(WIDE)} at {held}"
    return ""


def _other_temperatures(result: "Result") -> list[float]:
    """The temperatures of records in the folder that could be identified on too, and are not."""
    used = {file.temperature_degc for file in result.plan if file.role == "identification"}
    if len(used) != 1 or None in used:
        return []
    known = [degc for degc in used if degc is not None]
    for file in result.plan:
        degc = file.temperature_degc
        is_left = file.role == "not used" and file.kind in ("drive cycle", "pulse test")
        if is_left and degc is not None and all(abs(degc - own) > SAME_DEGC for own in known):
            known.append(degc)
    return sorted(known[1:])


def _missed_by_the_polynomial_v(cell: "CellModel") -> float:
    """The largest distance of polynomial OCV curves from their points."""
    branches = {"charge": cell.charge, "discharge": cell.discharge}
    missed = [
        cell.errors[name].max_v
        for name, curve in branches.items()
        if isinstance(curve, PolynomialCurve) and name in cell.errors
    ]
    return max(missed, default=0.0)
