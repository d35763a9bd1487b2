"""Every kind of sentence, from numbers made for it, against one golden file."""

import re
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

from barnax import CircuitParameters, Notice
from barnax.fit.cross_validation import SocErrors
from barnax.fleet import Progress
from barnax.global_optimum.search import GlobalOptimum
from barnax.reporting.first_screen import next_step
from barnax.reporting.wording import sentences, wording
from barnax.search.answers import Optimum
from barnax.uncertainty import Band, Diagnostics, Estimate, Undetermined
from barnax.uncertainty.covariance import NoiseParts, Uncertainty
from helpers.golden import require_golden
from helpers.results import make_table_result, with_fit

GOLDEN = Path(__file__).parent / "sentences.txt"
CIRCUIT = CircuitParameters.constant(0.05, (0.02, 0.03), (4.1 / 0.02, 150 / 0.03))
# What options of Python a sentence may name.
OPTIONS = {"bounds", "capacity", "initial_soc", "model", "retry", "score_soc"}


def optima() -> list[str]:
    best, other = (Optimum(rmse_v, CIRCUIT, 3, is_family=False) for rmse_v in (0.025, 0.02515))
    found = GlobalOptimum((best,), (), "certified", lower_bound_v=0.025 * (1 - 4.41e-6), boxes=812)
    tried = replace(found, status="grid-verified", lower_bound_v=0.0242, boxes=50_000)
    proved = (found, replace(found, lower_bound_v=0.025), tried, replace(tried, boxes=None))
    far = (replace(other, rmse_v=0.03), replace(other, rmse_v=0.035))
    local = (found, *(replace(found, optima=(best, *each)) for each in ((other,), far)))
    return [
        *(wording("circuit.optimum", each) for each in proved),
        *(wording("circuit.local_optima", each) for each in local),
    ]


def estimate(name: str, value: float, low: float, high: float) -> Estimate:
    return Estimate(name, value, None, 0.1, 0.02, 20.0, low, high)


R0, R1 = estimate("R0 [Ohm]", 0.05, 0.049, 0.051), estimate("R1 [Ohm]", 0.0149, 0.004, 0.06)
TAU1, TAU2 = estimate("tau1 [s]", 0.43, 0.05, 3.0), estimate("tau2 [s]", 25_000, 4000, 156_000)
R2, C2 = estimate("R2 [Ohm]", 0.1, 0.03, 0.3), estimate("C2 [F]", 2120, 1900, 2400)
SUM = estimate("R0 + R1 [Ohm]", 0.0649, 0.0640, 0.0658)


def findings() -> list[str]:
    def said(kind, *estimates, **given) -> str:
        undetermined = Undetermined(kind, estimates, 1.0, 19_680.0, **given)
        return wording("circuit.finding", undetermined)

    held = replace(TAU2, held="at upper bound", value=19_680.0)
    return [
        said("too fast", TAU1, R1, R0, combined=SUM),
        said("too fast", replace(TAU1, held="at lower bound"), combined=R1),
        said("too slow", TAU2, R2, combined=C2),
        said("too slow", held, R2, combined=C2),
        said(
            "too slow", held, replace(R2, held="at upper bound"), combined=Estimate("C2 [F]", 9.0)
        ),
        said("alike", TAU1, TAU2, R0, R1, combined=SUM),
        said("at bound", replace(R0, held="at upper bound")),
        said("at bound", replace(R0, held="unseen")),
        said("at bound", replace(R1, held="at upper bound", low=None, high=None)),
        said("at bound", replace(R1, held="at upper bound", low=None)),
        said("loose", R1),
        said("loose", replace(R1, low=None, high=None)),
        said("loose", TAU1),
        said("loose", TAU2),
        said("direction", R1, TAU1, log_steps=(0.8, -0.9), combined=SUM),
        said("direction", R1, TAU1, log_steps=(9.0, -9.0)),
        *sentences("circuit.identifiability", ()),
    ]


def errors() -> list[str]:
    noise = NoiseParts((0.0, 60.0), (1e-3, 5e-3))
    uncertainty = Uncertainty(0.95, 19_680, (R0, replace(R1, relative_error=0.3)), (), (), noise)
    soc = (Band(0.0, 0.1, 100, 0.0876, -0.06, 0.59), Band(0.1, 0.2, 1900, 0.012, 0.001, 0.41))
    current = (Band(-0.05, 0.05, 500, 1e-3, 0.0, 0.3), Band(2.0, None, 1500, 0.02, 0.0, 0.7))
    actual = Diagnostics((0.0, 1.0), (1.0, 0.99), 742.0, 7.41, 19_680, soc, current, None)
    warm = (Band(20.0, 21.0, 100, 0.03, 0.01, 0.9), Band(21.0, 22.0, 1900, 0.001, 0.0, 0.1))
    alone = replace(actual, effective_samples=0.3, by_soc=(), by_current=(), by_temperature=warm)
    return [
        wording("circuit.uncertainty", uncertainty),
        wording("circuit.uncertainty", replace(uncertainty, estimates=())),
        *sentences("circuit.diagnostics", actual),
        *sentences("circuit.diagnostics", alone),
    ]


def beyond() -> list[str]:
    """Where an SOC is within 0.5 % of the ends, nothing is told."""
    extents = {"a.csv": (-0.004, 1.0), "b.csv": (0.02, 1.0071), "c.csv": (-0.012, 1.0)}
    assert not sentences("starts.beyond", {"a.csv": extents["a.csv"]}, "the OCV test")
    return [*sentences("starts.beyond", extents, "the OCV test")]


def fleet() -> list[str]:
    """The end of a fleet counts what was done; its progress is the throughput."""
    states = Progress(finished=40, failed=2, skipped=3), Progress(skipped=5)
    done = [wording("fleet.done", each, 20.0) for each in states]
    return [*done, wording("fleet.progress", Progress(finished=30, failed=2), 20.0)]


SAID = (optima, findings, errors, beyond, fleet)


def test_every_sentence_is_as_in_the_golden_file():
    said = "".join(f"{each}\n" for make in SAID for each in make())
    assert "--" not in said
    assert {each.partition("=")[0] for each in re.findall("`(.*?)`", said)} <= OPTIONS
    require_golden(GOLDEN, said)


# Tables over SOC, by hand-made ends and errors.


def test_the_next_step_follows_from_what_was_held_out():
    result = make_table_result()
    held = SimpleNamespace(by_record=(), whole=SocErrors(0.0091, None))
    actual = with_fit(result, cross_validation=held)
    assert next_step(actual).advice.startswith("validate on another record")
    told = Notice("ocv-test.disagrees", {"median_v": 0.08, "largest_v": -0.7, "soc": 0.35})
    ocv = "see what the records tell without the OCV test"
    assert next_step(actual.model_copy(update={"warnings": (told,)})).advice.startswith(ocv)
    # Loose steps tell no OCV. Other reasons may come of the capacity of a wrong test.
    name = actual.of_role("identification")[0].name
    unfit = Notice("role.unfit", {"role": "identification", "reason": "why"}, name)
    short = replace(unfit, values={**unfit.values, "half_width": 0.5})
    record = "measure a drive cycle"
    for warnings, advised in (((short, told), record), ((unfit, told), ocv), ((unfit,), record)):
        step = next_step(actual.model_copy(update={"warnings": warnings}))
        assert step.advice.startswith(advised)
    missed = SimpleNamespace(by_record=(), whole=SocErrors(0.0245, None))
    lost = with_fit(result, cross_validation=missed)
    assert "the error on blocks held out is 24.50 mV, on what was fitted 4.90 mV" in (
        next_step(lost).advice
    )
