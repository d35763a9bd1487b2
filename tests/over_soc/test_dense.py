"""Intervals, nuisances and laws of tables against dense algebra on a few dozen samples."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import minimize

from barnax.cell import CircuitParameters, Dependence
from barnax.execution import in_float64
from barnax.over_soc import TableSettings, dependence
from barnax.over_soc.curves import curves_of
from barnax.over_soc.intervals import LIGHT, intervals_of
from barnax.over_soc.level import FREE_RIDGE, NEARLY_LEVEL_V
from barnax.over_soc.pack import R0, TOTAL, fit_pack
from barnax.over_soc.problem import reduced_objective
from barnax.over_soc.search import find_best
from helpers.dense import (
    CAPACITY_AH,
    NODES,
    TAU_S,
    columns_of,
    covariance_of,
    fitted_tables,
    made_record,
    penalty_of,
    prepared_of,
    reaches_of,
    slopes_of,
)

PLAIN = TableSettings(nodes=NODES, folds=0, max_boxes=0, ocv_correction=False)
BOX = {"tau1 [s]": (4.0, 20.0), "tau2 [s]": (30.0, 100.0)}
HELD = {name: (tau, tau) for name, tau in zip(BOX, TAU_S, strict=True)}
RESISTANCES = [(NODES, CAPACITY_AH, PLAIN.resistance_ridge)] * 3
LOG_SCALES = tuple(np.log(TAU_S).tolist())


def solved(jacobian, penalty, pushes):
    """What pushes move."""
    return np.linalg.solve(jacobian.T @ jacobian / len(jacobian) + penalty.T @ penalty, pushes)


def with_scales(penalty, count=2):
    return np.pad(penalty, ((0, 0), (0, count)))


@in_float64
def test_an_interval_is_students_t_times_the_root_of_the_sandwich():
    prepared = prepared_of(made_record())
    objective = reduced_objective([prepared], PLAIN, BOX)
    best = objective.solve(LOG_SCALES, exact=True)
    columns, base = columns_of(prepared, NODES, TAU_S)
    smooth = fitted_tables(columns, penalty_of(PLAIN, RESISTANCES), base)
    penalty = penalty_of(PLAIN, RESISTANCES, LIGHT)
    light = fitted_tables(columns, penalty, base)
    jacobian = np.hstack([columns, slopes_of(prepared, NODES, TAU_S, light)])
    penalty = with_scales(penalty)
    error = base + columns @ light
    errors, reaches = reaches_of(np.eye(14), jacobian, penalty, error, prepared.time_s)
    # What straight lines leave of the curves moves the tables as an error of the voltage does.
    curves = [*curves_of(objective, best)]
    left = sum(
        columns[:, objective.block(table)].sum(axis=1) * curve.above_lines(prepared.soc)
        for table, curve in enumerate(curves)
    )
    normal = jacobian.T @ jacobian / len(base) + penalty.T @ penalty
    moved = np.linalg.solve(normal, jacobian.T @ left / len(base))[:12]
    curved = light + np.concatenate([curve.sags for curve in curves]) - moved
    low = np.minimum(smooth, np.minimum(light, curved) - reaches[:12])
    high = np.maximum(smooth, np.maximum(light, curved) + reaches[:12])
    *nodes, first, second = intervals_of(objective, best)
    np.testing.assert_allclose([node.standard_error for node in nodes], errors[:12], rtol=1e-9)
    np.testing.assert_allclose([node.value for node in nodes], smooth, rtol=1e-9)
    np.testing.assert_allclose([node.low for node in nodes], low, rtol=1e-9)
    np.testing.assert_allclose([node.high for node in nodes], high, rtol=1e-9)
    # Intervals of time constants are those of their logarithms.
    for tau, reach, error in zip((first, second), reaches[12:], errors[12:], strict=True):
        ends = tau.value * np.exp([-reach, reach])
        np.testing.assert_allclose([tau.low, tau.high], ends, rtol=1e-9)
        assert tau.standard_error == pytest.approx(tau.value * error, rel=1e-9)


@in_float64
def test_the_interval_of_a_cell_of_a_pack_holds_the_circuit_s_own_error_too():
    prepared = prepared_of(made_record(200, interval_s=3.0))
    # The second cell has 10 % more R0.
    noise_v = 4e-4 * np.random.default_rng(5).standard_normal((200, 2))
    beside_v = noise_v - [0.0, 5e-3] * prepared.current_a[:, None]
    ocv_nodes = (0.5, 0.6, 0.7, 0.8, 0.9)
    tables = CircuitParameters.over_soc(NODES, TAU_S, (0.05,) * 4, ((0.02,) * 4, (0.03,) * 4))
    pack = fit_pack(prepared, tables, beside_v, ["A", "B"], replace(PLAIN, ocv_nodes=ocv_nodes))
    columns, _ = columns_of(prepared, NODES, TAU_S, ocv_nodes)
    weighed = [*RESISTANCES, (ocv_nodes, 1.0, FREE_RIDGE)]
    smooth, light = (penalty_of(PLAIN, weighed, scale) for scale in (1.0, LIGHT))
    level_v = np.median(prepared.voltage_v) + NEARLY_LEVEL_V * prepared.soc
    bases = prepared.voltage_v - level_v + np.column_stack([np.zeros(200), beside_v]).T
    lightly = [fitted_tables(columns, light, base) for base in bases]
    errors = [base + columns @ values for base, values in zip(bases, lightly, strict=True)]
    # Derivatives by the time constants are those of the mean cell.
    slopes = slopes_of(prepared, NODES, TAU_S, lightly[0])
    jacobian = np.hstack([columns, slopes])
    directions = np.zeros((2, 19))
    directions[0, :4], directions[1, :12] = 1 / 4, 1 / 4
    reaches = [
        reaches_of(directions, jacobian, with_scales(light), error, prepared.time_s)[1]
        for error in errors
    ]
    for cell, base, values, error, reach in zip(
        pack.cells, bases[1:], lightly[1:], errors[1:], reaches[1:], strict=True
    ):
        # To first order, tables at the cell's own time constants.
        pushes = np.append(np.zeros(17), slopes.T @ (errors[0] - error) / 200)
        told, near = (
            directions[:, :17] @ tables + directions @ solved(jacobian, with_scales(rows), pushes)
            for tables, rows in ((fitted_tables(columns, smooth, base), smooth), (values, light))
        )
        reach = np.hypot(reach, reaches[0])
        for place, name in enumerate((R0, TOTAL)):
            own = cell.values[name]
            ends = near[place] + reach[place] * np.array([-1, 1])
            low, high = min(told[place], ends[0]), max(told[place], ends[1])
            expected = [told[place], low, high]
            np.testing.assert_allclose([own.value, own.low, own.high], expected, rtol=1e-7)


@in_float64
def test_a_law_ends_where_what_cells_usually_have_and_the_records_pull_alike(monkeypatch):
    monkeypatch.setattr(dependence, "SETTLED", 1e-12)
    monkeypatch.setattr(dependence, "ROUNDS", 40)
    place = np.arange(120)
    degc = 15 + place / 12 + 2 * np.sin(place / 9)
    record = replace(made_record(120, interval_s=5.0), temperature_degc=degc)
    plain, first = prepared_of(record), Dependence(beta_per_k=0.03, reference_degc=20.0)
    box = {"tau1 [s]": (2.0, 30.0), "tau2 [s]": (20.0, 200.0)}
    objective = reduced_objective([plain.following(first)], PLAIN, box)
    penalty = penalty_of(PLAIN, RESISTANCES)

    def least_v2(log_beta, *log_taus):
        warmed = replace(
            record, current_a=np.exp(-np.exp(log_beta) * (degc - 20)) * plain.current_a
        )
        seen = replace(plain, record=warmed)
        columns, base = columns_of(seen, NODES, np.exp(log_taus))
        values = fitted_tables(columns, penalty, base)
        return np.mean((base + columns @ values) ** 2) + np.sum((penalty @ values) ** 2)

    def pulled(numbers):
        return math.log(least_v2(*numbers)) + 0.3 * (numbers[0] - usual) ** 2

    # 35 kJ/mol over the gas constant and the square of the temperature.
    usual = math.log(35e3 / 8.314 / 293.15**2)
    start = find_best(objective)
    law, log_taus = dependence._polished(objective, start, first)
    close = {"xatol": 1e-9, "fatol": 1e-14}
    expected = minimize(pulled, [math.log(0.03), *LOG_SCALES], method="Nelder-Mead", options=close)
    assert [math.log(law.beta_per_k), *log_taus] == pytest.approx(expected.x, abs=1e-5)


@in_float64
def test_the_interval_of_a_law_counts_what_cells_usually_have():
    place = np.arange(120)
    degc = 15 + place / 12 + 2 * np.sin(place / 9)
    record = replace(made_record(120, interval_s=5.0), temperature_degc=degc)
    beta, plain = 0.03, prepared_of(record)
    law = Dependence(beta_per_k=beta, reference_degc=20.0)
    objective = reduced_objective([plain.following(law)], PLAIN, BOX)
    best = objective.solve(LOG_SCALES, exact=True)

    def columns_at(beta):
        current_a = np.exp(-beta * (degc - 20)) * plain.current_a
        return columns_of(replace(plain, record=replace(record, current_a=current_a)), NODES, TAU_S)

    columns, base = columns_at(beta)
    penalty = penalty_of(PLAIN, RESISTANCES, LIGHT)
    light = fitted_tables(columns, penalty, base)
    warmed = replace(record, current_a=np.exp(-beta * (degc - 20)) * plain.current_a)
    by_tau = slopes_of(replace(plain, record=warmed), NODES, TAU_S, light)
    ends = [columns_at(beta * np.exp(step))[0] @ light for step in (1e-4, -1e-4)]
    jacobian = np.column_stack([columns, by_tau, (ends[0] - ends[1]) / 2e-4])
    # Half the curvature of J exp(pull (ln beta - usual)^2), and what is usual within 0.4.
    pull = 0.3 * best.objective_v2
    known = np.vstack([with_scales(penalty, 3), math.sqrt(pull) * np.eye(15)[14]])
    error = base + columns @ light
    noise_v2 = covariance_of(jacobian, error, plain.time_s)
    normal = jacobian.T @ jacobian / 120 + known.T @ known
    moved = np.linalg.solve(normal, jacobian.T / 120)
    back = np.linalg.solve(normal, np.eye(15)[:, 14]) * pull
    variance = np.diag(moved @ noise_v2 @ moved.T) + (0.4 * back) ** 2
    *nodes, first, second, found = intervals_of(objective, best)
    errors = [*(node.standard_error for node in nodes),
              *(each.standard_error / each.value for each in (first, second, found))]  # fmt: skip
    np.testing.assert_allclose(errors, np.sqrt(variance), rtol=1e-6)
