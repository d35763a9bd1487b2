"""The first screen: the answer, its errors, its reliability, and the next step."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal, NamedTuple

from ..cell.circuits import Circuit, get_circuit
from ..cell.curves import MISS_TOLERANCE_V, PolynomialCurve
from ..cell.elements import alike
from ..cell.model import SAME_DEGC
from ..cell.soc_axis import ABOVE_SOC
from ..checks.roles import are_unfit
from ..plan.choosing import MAKE_RECORD
from ..settings import OVER_TEMPERATURE
from .document import Page
from .pulses import middle_facts
from .view import View
from .wording import document, wording
from .words import joined, percent, symbol

if TYPE_CHECKING:
    from ..cell import CellModel
    from ..results import Result


def first_screen(result: "Result") -> Page:
    """The answer's errors and parameters, its reliability, and the assumptions behind it."""
    return document("screen", view=View(result), middle_facts=middle_facts(result))


# Unseen data are predicted badly if the error exceeds this multiple of the fit's, and this size;
# and as well as possible below the last value: undetermined tables do not matter then.
LOST, LOST_V, SMALL_V = 2.0, 0.01, 0.002
# A table needs a test if less than `FEW` of its nodes have a relative error below `WIDE`.
WIDE, FEW = 0.5, 1 / 3


@dataclass(frozen=True)
class Next:
    """The next step: a command on this result, or another run with options, or with a further
    record to identify on (`also`)."""

    advice: str
    options: Mapping[str, str] = field(default_factory=dict)
    also: str = ""
    command: Literal["identify", "export", "design"] = "identify"


def next_step(result: "Result") -> Next:
    """The most useful next step.

    First obvious problems: an OCV that misses its points, a circuit that cannot be the cell's,
    unsuitable records, an OCV test that disagrees with them, unused records at other temperatures.
    Then the error on unseen data decides (`Unseen`): more data if it is over `LOST` times the error
    of the fit, and over `LOST_V`; another validation record if it is unknown; constants if they are
    better on every validation record; a test if it is over `SMALL_V` and a resistance is
    undetermined at most nodes. Otherwise the circuit is good enough: export it to a format that
    represents its hysteresis.

    For a constant circuit there are other options instead of the last two.
    """
    view = View(result)
    missed_v = _missed_by_the_polynomial_v(result.cell)
    if missed_v > MISS_TOLERANCE_V:
        return Next(wording("next.interpolate", missed_v), {"ocv_fit": "interpolated"})
    upper = [bound.name for bound in result.at_bound if bound.side == "upper"]
    at_bound = [symbol(name) for name in upper if name.endswith("[Ohm]")]
    if len(at_bound) > 1 or (result.over is None and view.errors.r2 < 0):
        return Next(wording("next.no_circuit", at_bound))
    names = {part.name for part in view.identified}
    disagrees = any(warning.code == "ocv-test.disagrees" for warning in result.warnings)
    if are_unfit(names, result.warnings, by_steps=disagrees):
        return Next(wording("next.unfit", MAKE_RECORD, sorted(names)))
    if disagrees:
        return Next("see what the records tell without the OCV test, which disagrees with them")
    others = _other_temperatures(result)
    if others and result.over:
        return Next(wording("next.other_temperatures", others), {"over": OVER_TEMPERATURE})
    unseen = Unseen.of(view)
    if unseen and unseen.error_v >= max(LOST * unseen.fitted_v, LOST_V):
        also = unseen.name if view.validation and not view.is_pulse_test else ""
        return Next(wording("next.more_data", view, unseen), also=also)
    held_out = result.fit.cross_validation
    if not (view.validation_errors or (held_out and held_out.by_record)):
        return Next("validate on another record of the cell, with `validate`")
    if view.surpassed and len(view.surpassed) == len(view.validation_errors):
        return Next("take the constants, which validate better", {"model": result.constant.model})
    wide = _wide(view)
    if wide and unseen and unseen.error_v > SMALL_V:
        return Next(f"measure what is missing: {wide}", command="design")
    circuit = get_circuit(result.model)
    if result.over:
        what, target = _export(circuit)
        return Next(wording("next.export", what, result.fits), {"to": target}, command="export")
    if not result.tried and alike(circuit.elements) < len(circuit.elements):
        return Next("try tables over SOC of this circuit too", {"over": "soc"})
    if not result.tried:
        return Next("try tables over SOC too, without `model` or `setup`")
    if result.constant.assessment is None:
        return Next("compute intervals of the parameters", {"trust": "basic"})
    validated = joined([part.name for part in view.validation])
    return Next(f"compare circuits and methods with barnax compare; validated on {validated}")


class Unseen(NamedTuple):
    """Unseen data: the worst validation record, else what was held out of the fit.

    `error_v` is its error, `fitted_v` that of the fit: both above 10 % SOC, because no circuit
    follows a discharge to its end, or both on all samples, with the start of the record adjusted,
    if that error is smaller or the other is unknown. `where` says which.
    """

    error_v: float
    fitted_v: float
    name: str
    where: str

    @classmethod
    def of(cls, view: View) -> "Unseen | None":
        """None if there are none."""

        def least(name: str, above_v: float | None, all_v: float, how: str = "") -> Unseen:
            whole = cls(all_v, view.errors.rmse_v, name, how)
            fitted_above_v = view.errors.rmse_above_10_soc_v
            if above_v is None or fitted_above_v is None:
                return whole
            return min(
                cls(above_v, fitted_above_v, name, f"above {percent(ABOVE_SOC)} SOC "), whole
            )

        others = []
        for part in view.validation_errors:
            moved_v = part.registered_v or part.rmse_v
            how = "with its start moved, " if moved_v < part.rmse_v else ""
            others.append(least(part.record, part.rmse_above_10_soc_v, moved_v, how))
        held_out = view.result.fit.cross_validation
        if held_out is not None and not others:
            name = "records left out" if held_out.by_record else "blocks held out"
            others.append(least(name, held_out.whole.above_v, held_out.whole.rmse_v))
        return max(others, default=None)


def _export(circuit: Circuit) -> tuple[str, str]:
    """A format that represents a circuit's hysteresis, in words and by its name in `export`."""
    if circuit.hysteresis.kind == "loops":
        return "as a filter in C", "c-filter"
    return ("as CSV", "csv") if circuit.has_hysteresis else ("to PyBaMM", "pybamm")


def _wide(view: View) -> str:
    """A table that is undetermined nearly everywhere; empty if there is none."""
    if view.result.over in (None, OVER_TEMPERATURE):
        return ""
    for name in view.result.fit.tables.resistances:
        nodes = view.result.fit.of_table(name)
        narrow = sum(n.low is not None and n.standard_error <= WIDE * n.value for n in nodes)
        if narrow < FEW * len(nodes):
            where = f"{narrow} of {len(nodes)} nodes"
            return f"the standard error of {symbol(name)} is under {percent(WIDE)} at {where}"
    return ""


def _other_temperatures(result: "Result") -> list[float]:
    """The temperatures of records in the folder that could be identified on too, and are not."""
    used = {file.temperature_degc for file in result.plan if file.role == "identification"}
    if len(used) != 1 or None in used:
        return []
    all_degc = [degc for degc in used if degc is not None]
    for file in result.plan:
        degc = file.temperature_degc
        is_left = file.role == "not used" and file.kind in ("drive cycle", "pulse test")
        if is_left and degc is not None and all(abs(degc - one) > SAME_DEGC for one in all_degc):
            all_degc.append(degc)
    return sorted(all_degc[1:])


def _missed_by_the_polynomial_v(cell: "CellModel") -> float:
    """The largest distance of polynomial OCV curves from their points."""
    branches = {"charge": cell.charge, "discharge": cell.discharge}
    curves = [name for name, curve in branches.items() if isinstance(curve, PolynomialCurve)]
    return max((cell.errors[name].max_v for name in curves if name in cell.errors), default=0.0)
