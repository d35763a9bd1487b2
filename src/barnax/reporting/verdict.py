"""The one verdict of a result: how good it is, where it is weak, and what to do next."""

from collections.abc import Iterator
from typing import TYPE_CHECKING

from ..cell.curves import MISS_TOLERANCE_V, PolynomialCurve
from ..cell.model import SAME_DEGC
from ..inputs import OVER_TEMPERATURE
from ..over_soc.cross_validation import WORTHWHILE
from ..pipeline import FITTING_AGAIN
from .sentences import (
    WORTH_TELLING,
    diagnostics_sentences,
    local_optima_sentence,
    nearly_as_good,
    optimum_words,
    option,
)
from .soc_tables import (
    best_of,
    tables_pay,
    unseen_errors,
)
from .words import (
    counted,
    joined,
    millivolt,
    percent,
    symbol,
)

if TYPE_CHECKING:
    from ..cell import CellModel
    from ..results import Result

# Most of the squared error of most cells is where they are nearly empty.
LOW_SOC = 0.1
MUCH = 0.5
# Tables over SOC that would save so much of the error come before any other step.
HALF = 0.5


def circuit_words(result: "Result") -> str:
    """Which circuit the answer is."""
    return result.model if result.tables is None else f"{result.model} with tables over SOC"


def best_possible(result: "Result") -> str:
    """Whether a better circuit exists in the bounds, and how many seeds found this one."""
    optimum, refined = result.global_optimum, result.refined
    seeds = 0 if refined is None else len(refined.seeds)
    if result.tables is not None:
        return best_of(result.tables)
    if optimum is None:
        reached = refined.optima[0].seeds if refined else 0
        return (
            "not known: the bounds are too wide to look for the global optimum; "
            f"{reached} of {counted(seeds, 'seed')} end in the best optimum found."
        )
    if result.answer_source == "seeds":
        gap = percent(optimum.rmse_v / result.metrics.identification.rmse_v - 1)
        return f"not proved: the seeds found a circuit {gap} better than the grid."
    found = f" ({optimum.seeds_there} of {counted(seeds, 'seed')} found it)" if seeds else ""
    return f"{optimum_words(optimum)}{found}. {nearly_as_good(optimum)}".rstrip()


def seeds_sentences(result: "Result") -> Iterator[str]:
    """How far the seeds stayed from the optimum, and where else there is one."""
    optimum, refined = result.global_optimum, result.refined
    if optimum is None:
        return
    if refined is None:
        yield local_optima_sentence(optimum)
        return
    seeds = len(refined.seeds)
    yield (
        f"Optimality gap (RMSE above that of the optimum): best seed {_gap(optimum.best_gap)}, "
        f"median seed {_gap(optimum.median_gap)}; after refinement {_gap(optimum.refined_gap)}. "
        f"{optimum.seeds_there} of {counted(seeds, 'seed')} reach the optimum after refinement."
    )
    yield local_optima_sentence(optimum)
    moving = sum(not seed.has_converged for seed in refined.seeds)
    if moving:
        yield f"{counted(moving, 'seed')} had not converged when refinement ended."


def weakest_point(result: "Result") -> str:
    """Where most of the error is, empty where it is nowhere in particular."""
    if result.tables is not None:
        bands = result.tables.by_soc
    elif result.assessment is not None:
        bands = result.assessment.diagnostics.by_soc
    else:
        return ""
    low = [band for band in bands if band.high is not None and band.high <= LOW_SOC + 1e-9]
    share = sum(band.share for band in low)
    if share > MUCH:
        samples = sum(band.samples for band in low) / sum(band.samples for band in bands)
        return (
            f"{percent(share)} of the squared error is below {percent(LOW_SOC)} SOC, in "
            f"{percent(samples)} of the samples."
        )
    if result.tables is not None or result.assessment is None:
        return ""
    _, *notable = diagnostics_sentences(result.assessment.diagnostics)
    return notable[0] if notable else ""


def tables_would_pay(result: "Result", share: float = WORTHWHILE) -> bool:
    """Whether tables over SOC, which were not asked for, would lower the error by that share."""
    expected_v, own_v = result.expected_tables_v, result.metrics.identification.rmse_v
    return expected_v is not None and expected_v < (1 - share) * own_v


def _no_circuit(result: "Result") -> str:
    """Why the answer cannot be the cell's, empty where it may be."""
    at_bound = [
        symbol(each.name)
        for each in result.at_bound
        if each.name.endswith("[Ohm]") and each.side == "upper"
    ]
    if len(at_bound) > 1:
        return f"{joined(at_bound)} end at their upper bounds"
    worse = result.metrics.identification.r2 < 0
    return "a constant voltage would fit as well" if worse else ""


def next_step(result: "Result") -> tuple[dict[str, str], str]:
    """Options to run again with, and why; no options where it takes something else."""
    missed_v = _missed_by_the_polynomial_v(result.cell)
    if missed_v > MISS_TOLERANCE_V:
        missed = millivolt(missed_v)
        what = f"interpolate the OCV; the polynomial misses its points by up to {missed}"
        return {"ocv_fit": "interpolated"}, what
    if result.tables is None and (reason := _no_circuit(result)):
        what = "check the OCV test, `capacity`, the window and `bounds`"
        return {}, f"{what}: {reason}"
    if not result.metrics.validation and not tables_would_pay(result, HALF):
        return {}, "validate on another record of the cell, with `validate`"
    others = _other_temperatures(result)
    if others and (result.tables is not None or tables_would_pay(result)):
        where = joined([f"{degc:.3g}" for degc in others])
        what = f"for tables over temperature too, with the records at {where} degC"
        return {"over": OVER_TEMPERATURE}, what
    if result.tables is not None and not tables_pay(result.tables.fit, unseen_errors(result)):
        return {}, "use the constant circuit: identify again without `over`"
    if result.tables is not None:
        return {}, "export the tables with barnax export"
    if tables_would_pay(result):
        expected = millivolt(result.expected_tables_v or 0.0)
        return {"over": "soc"}, f"fit tables over SOC, for an RMSE of about {expected}"
    found = result.assessment
    if found is None:
        return {"trust": "basic"}, "compute intervals of the parameters"
    has_failed = any(text.startswith(FITTING_AGAIN) for text in result.warnings)
    if found.examination is None and not has_failed:
        return {"trust": "full"}, "find out what would lower the error"
    rmse_v = result.metrics.identification.rmse_v
    suggested = () if found.examination is None else found.examination.suggestions
    for each in suggested:
        if option(each) and each.rmse_v < (1 - WORTH_TELLING) * rmse_v:
            options = option(each)
            names = [part.name for part in result.of_role("identification")]
            if "initial_soc" in options and len(names) == 1:
                # A start is one record's; the others keep theirs.
                options["initial_soc"] = f"{names[0]}={options['initial_soc']}"
            return options, f"lower the RMSE to {millivolt(each.rmse_v)}"
    names = [each.name for each in result.of_role("validation")]
    return {}, f"compare circuits and methods with barnax compare; validated on {joined(names)}"


def _other_temperatures(result: "Result") -> list[float]:
    """The temperatures of records in the folder that could be identified on too, and are not."""
    used = {each.temperature_degc for each in result.plan if each.role == "identification"}
    if len(used) != 1 or None in used:
        return []
    found: list[float] = []
    for each in result.plan:
        degc = each.temperature_degc
        is_left = each.role == "not used" and each.kind in ("drive cycle", "pulse test")
        known = [*used, *found]
        if (
            is_left
            and degc is not None
            and all(abs(degc - one) > SAME_DEGC for one in known if one is not None)
        ):
            found.append(degc)
    return sorted(found)


def _missed_by_the_polynomial_v(cell: "CellModel") -> float:
    """How far the OCV curves pass from their points where another kind of fit would not."""
    branches = {"charge": cell.charge, "discharge": cell.discharge}
    missed = [
        cell.errors[name].max_v
        for name, curve in branches.items()
        if isinstance(curve, PolynomialCurve) and name in cell.errors
    ]
    return max(missed, default=0.0)


def _gap(gap: float) -> str:
    return "none" if gap < 1e-7 else percent(gap)
