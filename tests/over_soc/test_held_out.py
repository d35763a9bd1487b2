"""Errors on what is held out, and what other records show, against fits of the other samples."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import t as student

from barnax.execution import in_float64
from barnax.over_soc import TableSettings
from barnax.over_soc.cross_validation import SocErrors, held_out_errors, with_spread
from barnax.over_soc.dependence import is_worth
from barnax.over_soc.intervals import NodeInterval
from barnax.over_soc.problem import reduced_objective
from helpers.dense import (
    CAPACITY_AH,
    NODES,
    TAU_S,
    columns_of,
    fitted_tables,
    made_record,
    penalty_of,
    prepared_of,
)

SETTINGS = TableSettings(nodes=NODES, folds=2, max_boxes=0, ocv_correction=False)
HELD = {name: (tau, tau) for name, tau in zip(("tau1 [s]", "tau2 [s]"), TAU_S, strict=True)}
PENALTY = penalty_of(SETTINGS, [(NODES, CAPACITY_AH, SETTINGS.resistance_ridge)] * 3)
LOG_SCALES = tuple(np.log(TAU_S).tolist())


@in_float64
@pytest.mark.parametrize("folds", [2, 3])
def test_every_fold_is_predicted_by_the_tables_of_the_others(folds):
    prepared = prepared_of(made_record(240, interval_s=3.0))
    objective = reduced_objective([prepared], replace(SETTINGS, folds=folds), HELD)
    columns, base = columns_of(prepared, NODES, TAU_S)
    # Five blocks of a fold fill the record.
    block_s = (prepared.time_s[-1] - prepared.time_s[0]) / (5 * folds)
    fold = np.floor(prepared.time_s / block_s).astype(int) % folds
    squares_v2 = 0.0
    for held in range(folds):
        others = fold != held
        tables = fitted_tables(columns[others], PENALTY, base[others])
        squares_v2 += np.sum((base + columns @ tables)[~others] ** 2)
    found = held_out_errors(objective, objective.solve(LOG_SCALES))
    assert found.rmse_v == pytest.approx(math.sqrt(squares_v2 / len(base)), rel=1e-8)
    assert found.above_v == found.rmse_v


@in_float64
def test_another_record_is_predicted_by_the_spread_of_those_there_are():
    records = [
        prepared_of(made_record(200, seed, interval_s=3.0, name=f"{seed}.csv")) for seed in range(3)
    ]
    objective = reduced_objective(records, SETTINGS, HELD)
    own = np.array(
        [
            fitted_tables(columns, PENALTY, base)
            for columns, base in (columns_of(prepared, NODES, TAU_S) for prepared in records)
        ]
    )
    at = 4 + 1
    assert all(prepared.nearest(np.array(NODES))[1] for prepared in records)
    joint = NodeInterval("R1 [Ohm]", NODES[1], 0.02, 1e-3, 0.0, 0.0199, 0.0201)
    (found,) = with_spread(objective, objective.solve(LOG_SCALES), [joint])
    # Of one more draw from a normal distribution that three are known of.
    reach = student.ppf(0.975, 2) * np.std(own[:, at], ddof=1) * math.sqrt(1 + 1 / 3)
    ends = np.mean(own[:, at]) + reach * np.array([-1, 1])
    assert found.record_low == pytest.approx(min(max(ends[0], 0.0), joint.low), rel=1e-8)
    assert found.record_high == pytest.approx(max(ends[1], joint.high), rel=1e-8)


@pytest.mark.parametrize(
    ("one", "simpler", "is_it"),
    [
        ((8.9, 4.4), (10.0, 5.0), True),
        # A tenth of both, or it is not worth it.
        ((8.9, 4.6), (10.0, 5.0), False),
        ((9.1, 4.4), (10.0, 5.0), False),
        ((8.9, None), (10.0, None), True),
        # What no voltmeter resolves.
        ((0.15, 0.15), (0.20, 0.20), False),
    ],
)
def test_a_circuit_is_worth_more_if_both_errors_fall_by_a_tenth(one, simpler, is_it):
    one, simpler = (
        SocErrors(1e-3 * errors[0], errors[1] and 1e-3 * errors[1]) for errors in (one, simpler)
    )
    assert one.is_worth(simpler) is is_it


@pytest.mark.parametrize(
    ("one", "without", "is_it"),
    [
        ((9.7, 5.0), (10.0, 5.0), True),
        ((9.9, 4.0), (10.0, 5.0), False),
        ((9.7, 5.01), (10.0, 5.0), False),
        ((9.7, None), (10.0, None), True),
    ],
)
def test_a_law_is_worth_two_percent_and_no_harm_above_10_percent_soc(one, without, is_it):
    assert is_worth(SocErrors(*one), SocErrors(*without)) is is_it
