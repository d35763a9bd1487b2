"""Comparisons made by hand, whose every number a test knows."""

from collections.abc import Sequence
from functools import cache

import numpy as np

from barnax import CellModel, CircuitParameters, Notice, bundled_file, characterize, read_record
from barnax.baselines import Answer, Budget
from barnax.comparison import ComparisonResult, Row
from barnax.comparison.result import Difference, ModelPart, RecordErrors, Resampled, SeedPairs
from barnax.global_optimum.search import GlobalOptimum
from barnax.metrics import Metrics
from barnax.records import Decision
from barnax.result_parts import InputPart
from barnax.search.answers import Optimum, RefinedSeed
from barnax.uncertainty import Band

DRIVE, CITY = "drive.csv", "city.csv"
PARAMETERS = {
    "R0 [Ohm]": 0.05,
    "R1 [Ohm]": 0.01,
    "C1 [F]": 1000.0,
    "R2 [Ohm]": 0.02,
    "C2 [F]": 5000.0,
}
BOX = {
    "R0 [Ohm]": (1e-4, 0.2),
    "R1 [Ohm]": (1e-4, 0.2),
    "R2 [Ohm]": (1e-4, 0.2),
    "tau1 [s]": (0.5, 5000.0),
    "tau2 [s]": (0.5, 5000.0),
}


@cache
def bundled_cell() -> CellModel:
    return characterize(
        [read_record(bundled_file(f"ocv_{way}")) for way in ("charge", "discharge")],
        ocv_fit="polynomial",
    )


def make_errors(record: str, rmse_v: float, low_samples: int = 100) -> RecordErrors:
    """A hundred samples below 10 % SOC with twice the error, nine hundred above 20 %."""
    low = Band(0.0, 0.1, low_samples, 2 * rmse_v, -rmse_v, 0.3)
    high = Band(0.2, 1.0, 900, rmse_v, 0.001, 0.7)
    return RecordErrors(
        metrics=Metrics(
            record=record,
            rmse_v=rmse_v,
            r2=0.99,
            r2_paper=0.991,
            mape_percent=0.4,
            ce_v=12.3,
            max_v=0.16,
            samples=900 + low_samples,
        ),
        bands=(low, high) if low_samples else (high,),
    )


def make_row(
    name: str, *rmse_mv: float, seeds: int = 3, notes: tuple[str, ...] = (), **changes: object
) -> Row:
    """An answered row, such as `ibmo so-rc`, with its RMSE on every record in mV."""
    method, model = name.split()
    identified_v, *validated_v = (value / 1e3 for value in rmse_mv)
    parameters = PARAMETERS | ({"gamma": 300.0} if model == "esc" else {})
    circuit = CircuitParameters.from_dict(parameters)
    # The second of three is the median.
    ratios = [1.0] if seeds == 1 else [0.99, 1.0, *np.linspace(1.01, 1.02, seeds - 2)]
    answers = tuple(
        Answer(rmse_v=identified_v * ratio, parameters=circuit, evaluations=300, notes=notes)
        for ratio in ratios
    )
    errors = [make_errors(DRIVE, identified_v)]
    for place, value in enumerate(validated_v):
        errors.append(make_errors(CITY if place == 0 else f"city-{place}.csv", value))
    values: dict = {
        "model": model,
        "method": method,
        "source": "made by hand",
        "is_deterministic": seeds == 1,
        "answers": answers,
        "errors": tuple(errors),
        "refined": make_refined(identified_v, parameters),
    }
    return Row(**values | changes)


def make_refined(rmse_v: float, parameters: dict[str, float] = PARAMETERS) -> RefinedSeed:
    return RefinedSeed(rmse_v, CircuitParameters.from_dict(parameters), 0.0, True)


def make_optimum(rmse_v: float, **changes: object) -> GlobalOptimum:
    best = Optimum(rmse_v, CircuitParameters.from_dict(PARAMETERS), seeds=0, is_family=False)
    values: dict = {"status": "grid-verified", "lower_bound_v": rmse_v, "boxes": None}
    return GlobalOptimum((best,), (), **values | changes)


def make_failure(name: str, reason: str) -> Row:
    method, model = name.split()
    return Row(model, method, "made by hand", is_deterministic=True, failure=reason)


def make_difference(
    first: str,
    second: str,
    interval_mv: tuple[float, float],
    *,
    record: str = DRIVE,
    seeds: tuple[int, int, float] | None = None,
    is_capped: bool = False,
) -> Difference:
    """A difference in the middle of its interval, real where that leaves out zero."""
    low_v, high_v = (end / 1e3 for end in interval_mv)
    over_seeds = None
    if seeds is not None:
        wins, losses, p_value = seeds
        over_seeds = SeedPairs(median_v=0.0, wins=wins, losses=losses, p_value=p_value)
    return Difference(
        first=first,
        second=second,
        record=record,
        is_validation=record != DRIVE,
        over_time=Resampled(
            difference_v2=0.0,
            interval_v2=(low_v, high_v),
            difference_v=(low_v + high_v) / 2,
            interval_v=(low_v, high_v),
            block_samples=50,
            is_block_capped=is_capped,
            is_real=low_v > 0 or high_v < 0,
        ),
        over_seeds=over_seeds,
    )


def make_comparison(
    rows: Sequence[Row],
    differences: Sequence[Difference] = (),
    optima_mv: dict[str, float] | None = None,
    names: dict[str, str] | None = None,
    **changes: object,
) -> ComparisonResult:
    """A comparison of these rows; `names` replaces the names of its files."""
    optima = {model: make_optimum(mv / 1e3) for model, mv in (optima_mv or {}).items()}
    files = {"identification": DRIVE, "validation": CITY, "ocv": "ocv.csv"} | (names or {})
    decision = Decision(value="charge-positive", strength="strong", reason="the steps say so")
    hold = Decision(value="forward", strength="assumed", reason="no counters")
    values: dict = {
        "rows": tuple(rows),
        "differences": tuple(differences),
        "models": {
            row.model: ModelPart(bounds=BOX, fixed={}, optimum=optima.get(row.model))
            for row in rows
        },
        "budget": Budget(population=30, iterations=9, seeds=3, key=7),
        "coordinates": "rc",
        "objective": "scan",
        "cell": bundled_cell(),
        "inputs": tuple(
            InputPart(role=role, name=name, sha256="0123456789abcdef" * 4, sign=decision, hold=hold)
            for role, name in files.items()
        ),
        "warnings": (Notice("stored.text", {"text": "the file is odd"}),),
        "versions": {"barnax": "0.1.0"},
    }
    return ComparisonResult(**values | changes)
