"""Intervals, nuisances and laws of tables against dense algebra on a few dozen samples."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import block_diag
from scipy.optimize import minimize
from scipy.stats import t as student

from barnax.cell import CircuitParameters, Dependence
from barnax.execution import in_float64
from barnax.fit import dependence
from barnax.fit.cross_validation import held_out, with_spread
from barnax.fit.flat_ocv import FREE_RIDGE, NEARLY_LEVEL_V
from barnax.fit.intervals import LIGHT, NodeInterval, intervals_of
from barnax.fit.nuisances import PseudoMeasurements, estimate
from barnax.fit.pack import R0, TOTAL, fit_pack
from barnax.fit.table_curves import curves_of
from barnax.fit.table_problem import find_best, reduced_objective
from helpers.dense import (
    BOX,
    LOG_SCALES,
    NODES,
    SETTINGS,
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

# The mean of lines between the nodes: half an interval of each end's.
TRAPEZOIDS = np.array([1, 2, 2, 1]) / 6
HELD = {name: (tau, tau) for name, tau in zip(BOX, TAU_S, strict=True)}


def solved(jacobian, penalty, pushes):
    """What pushes move."""
    return np.linalg.solve(jacobian.T @ jacobian / len(jacobian) + penalty.T @ penalty, pushes)


def with_scales(penalty, count=2):
    return np.pad(penalty, ((0, 0), (0, count)))


@in_float64
def test_an_interval_is_students_t_times_the_root_of_the_sandwich():
    """Of nodes, of the means of tables between them, and of time constants."""
    prepared = prepared_of(made_record())
    objective = reduced_objective([prepared], SETTINGS, BOX)
    best = objective.solve(LOG_SCALES, exact=True)
    columns, base = columns_of(prepared)
    smooth = fitted_tables(columns, penalty_of(), base)
    light = fitted_tables(columns, penalty_of(LIGHT), base)
    jacobian = np.hstack([columns, slopes_of(prepared, light)])
    penalty = with_scales(penalty_of(LIGHT))
    error = base + columns @ light
    weights = np.vstack([np.eye(12), np.kron(np.eye(3), TRAPEZOIDS)])
    directions = block_diag(weights, np.eye(2))
    errors, reaches = reaches_of(directions, jacobian, penalty, error, prepared.time_s)
    # What straight lines leave of the curves moves the tables as an error of the voltage does.
    curves = [*curves_of(objective, best)]
    left = sum(
        columns[:, objective.block(table)].sum(axis=1) * curve.above_lines(prepared.soc)
        for table, curve in enumerate(curves)
    )
    moved = solved(jacobian, penalty, jacobian.T @ left / len(base))[:12]
    soc = NODES[0] + (NODES[-1] - NODES[0]) * (np.arange(3000) + 0.5) / 3000
    above = [*(curve.sags for curve in curves)]
    above += [[np.mean(curve.above_lines(soc))] for curve in curves]
    smooth, light, moved = (weights @ values for values in (smooth, light, moved))
    curved = light + np.concatenate(above) - moved
    low = np.minimum(smooth, np.minimum(light, curved) - reaches[:15])
    high = np.maximum(smooth, np.maximum(light, curved) + reaches[:15])
    low[12:] = np.maximum(low[12:], 0.0)
    actual = intervals_of(objective, best)
    tables, taus = (*actual[:12], *actual[14:17]), actual[12:14]
    assert [own.name for own in tables[12:]] == ["R0 [Ohm]", "R1 [Ohm]", "R2 [Ohm]"]
    np.testing.assert_allclose([own.standard_error for own in tables], errors[:15], rtol=1e-9)
    np.testing.assert_allclose([own.value for own in tables], smooth, rtol=1e-9)
    # The mean of a curve is taken at many points.
    for of, rtol in ((slice(12), 1e-9), (slice(12, 15), 1e-6)):
        np.testing.assert_allclose([own.low for own in tables[of]], low[of], rtol=rtol)
        np.testing.assert_allclose([own.high for own in tables[of]], high[of], rtol=rtol)
    # Intervals of time constants are those of their logarithms.
    for tau, reach, error in zip(taus, reaches[15:], errors[15:], strict=True):
        ends = tau.value * np.exp([-reach, reach])
        np.testing.assert_allclose([tau.low, tau.high], ends, rtol=1e-9)
        assert tau.standard_error == pytest.approx(tau.value * error, rel=1e-9)


@in_float64
def test_the_interval_of_a_cell_of_a_pack_holds_the_circuit_s_error_too():
    prepared = prepared_of(made_record(200, interval_s=3.0))
    # The second cell has 10 % more R0.
    noise_v = 4e-4 * np.random.default_rng(5).standard_normal((200, 2))
    voltage_offsets_v = noise_v - [0.0, 5e-3] * prepared.current_a[:, None]
    ocv_nodes = (0.5, 0.6, 0.7, 0.8, 0.9)
    tables = CircuitParameters.over_soc(NODES, TAU_S, (0.05,) * 4, ((0.02,) * 4, (0.03,) * 4))
    pack = fit_pack(
        prepared, tables, voltage_offsets_v, ["A", "B"], replace(SETTINGS, ocv_nodes=ocv_nodes)
    )
    columns, _ = columns_of(prepared, ocv_nodes)
    smooth, light = (penalty_of(scale, ocv_nodes, FREE_RIDGE) for scale in (1.0, LIGHT))
    level_v = np.median(prepared.voltage_v) + NEARLY_LEVEL_V * prepared.soc
    bases = prepared.voltage_v - level_v + np.column_stack([np.zeros(200), voltage_offsets_v]).T
    lightly = [fitted_tables(columns, light, base) for base in bases]
    errors = [base + columns @ values for base, values in zip(bases, lightly, strict=True)]
    # Derivatives by the time constants are those of the mean cell.
    slopes = slopes_of(prepared, lightly[0])
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
        smoothly, near = (
            directions[:, :17] @ tables + directions @ solved(jacobian, with_scales(rows), pushes)
            for tables, rows in ((fitted_tables(columns, smooth, base), smooth), (values, light))
        )
        reach = np.hypot(reach, reaches[0])
        for row, name in enumerate((R0, TOTAL)):
            value = cell.values[name]
            ends = near[row] + reach[row] * np.array([-1, 1])
            low, high = min(smoothly[row], ends[0]), max(smoothly[row], ends[1])
            expected = [smoothly[row], low, high]
            np.testing.assert_allclose([value.value, value.low, value.high], expected, rtol=1e-7)


@in_float64
def test_a_law_ends_where_what_cells_usually_have_and_the_records_pull_alike(monkeypatch):
    monkeypatch.setattr(dependence, "SETTLED", 1e-12)
    monkeypatch.setattr(dependence, "ROUNDS", 40)
    sample = np.arange(120)
    degc = 15 + sample / 12 + 2 * np.sin(sample / 9)
    record = replace(made_record(120, interval_s=5.0), temperature_degc=degc)
    plain, first = prepared_of(record), Dependence(beta_per_k=0.03, reference_degc=20.0)
    objective = reduced_objective([plain.with_dependence(first)], SETTINGS, BOX)
    penalty = penalty_of()

    def least_v2(log_beta, *log_taus):
        warmed = replace(
            record, current_a=np.exp(-np.exp(log_beta) * (degc - 20)) * plain.current_a
        )
        seen = replace(plain, record=warmed)
        columns, base = columns_of(seen, (), np.exp(log_taus))
        values = fitted_tables(columns, penalty, base)
        return np.mean((base + columns @ values) ** 2) + np.sum((penalty @ values) ** 2)

    def pulled(numbers):
        return math.log(least_v2(*numbers)) + 0.3 * (numbers[0] - usual) ** 2

    # 35 kJ/mol over the gas constant and the square of the temperature.
    usual = math.log(35e3 / 8.314 / 293.15**2)
    start = find_best(objective)
    law, log_taus = dependence.refine_dependence(objective, start, first)
    close = {"xatol": 1e-9, "fatol": 1e-14}
    expected = minimize(pulled, [math.log(0.03), *LOG_SCALES], method="Nelder-Mead", options=close)
    assert [math.log(law.beta_per_k), *log_taus] == pytest.approx(expected.x, abs=1e-5)


@in_float64
@pytest.mark.parametrize("is_measured", [False, True])
def test_nuisances_are_the_dense_least_squares_of_everything_at_once(is_measured):
    prepared = prepared_of(made_record(), soc=0.905)
    objective = reduced_objective([prepared], SETTINGS, BOX)
    best = objective.solve(LOG_SCALES, exact=True)
    slope = 0.7 + np.sin(prepared.time_s / 90)
    of_start = np.column_stack([slope, slope * (prepared.soc[0] - prepared.soc)])
    now, prior = np.array([2e-3, -1e-3]), np.array([4e-3, 1e-2])
    beside = PseudoMeasurements(np.array([[30.0, 5.0]]), np.array([0.8])) if is_measured else None
    wanted = np.zeros((1, 12))
    wanted[0, [1, 5, 9]] = 1.0
    (estimated,) = estimate(objective, best, lambda *_: of_start, now, [prior], wanted, beside)

    columns, base = columns_of(prepared)
    penalty, samples = penalty_of(LIGHT), len(base)
    light = fitted_tables(columns, penalty, base)
    error = base + columns @ light
    jacobian = np.hstack([columns, slopes_of(prepared, light), -of_start])
    noise_v2 = covariance_of(jacobian, error, prepared.time_s)
    unit = np.linalg.qr(jacobian)[0]
    weight = np.trace(unit.T @ noise_v2 @ unit) / 16 / samples
    # Of what is known, in standard deviations: by how much it moves, and by how much it is off.
    priors, off = np.zeros((2, 16)), now / prior
    priors[[0, 1], [14, 15]] = 1 / prior
    if is_measured:
        priors, off = np.vstack([priors, [0.0] * 14 + [30.0, 5.0]]), np.append(off, -0.8)
    penalty = np.pad(penalty, ((0, 0), (0, 4)))
    stiff = jacobian.T @ jacobian / samples + penalty.T @ penalty + weight * priors.T @ priors
    pushes = jacobian.T @ error / samples + weight * priors.T @ off
    moved = np.linalg.solve(stiff, pushes)
    by_noise = np.linalg.solve(stiff, jacobian.T / samples)
    by_known = np.linalg.solve(stiff, weight * priors.T)
    covariance = by_noise @ noise_v2 @ by_noise.T + by_known @ by_known.T
    total = np.pad(wanted, ((0, 0), (0, 4)))[0]
    np.testing.assert_allclose(estimated.values[:2], now - moved[14:], rtol=1e-7)
    np.testing.assert_allclose(estimated.covariance[:2, :2], covariance[14:, 14:], rtol=1e-7)
    np.testing.assert_allclose(estimated.moved_scales, -moved[12:14], rtol=1e-6)
    assert estimated.values[2] == pytest.approx(wanted[0] @ light - total @ moved, rel=1e-8)
    assert estimated.errors[2] == pytest.approx(math.sqrt(total @ covariance @ total), rel=1e-8)
    np.testing.assert_allclose(estimated.by_prior[:2], by_known[14:, :2], rtol=1e-7)
    misfit = off @ off - pushes @ moved / weight
    evidence = -(misfit + np.linalg.slogdet(stiff)[1]) / 2 - np.log(prior).sum()
    assert estimated.log_evidence == pytest.approx(evidence, rel=1e-7)


@in_float64
@pytest.mark.parametrize("folds", [2, 3])
def test_every_fold_is_predicted_by_the_tables_of_the_others(folds):
    prepared = prepared_of(made_record(240, interval_s=3.0))
    objective = reduced_objective([prepared], replace(SETTINGS, folds=folds), HELD)
    columns, base = columns_of(prepared)
    # Five blocks of a fold fill the record.
    block_s = (prepared.time_s[-1] - prepared.time_s[0]) / (5 * folds)
    fold = np.floor(prepared.time_s / block_s).astype(int) % folds
    squares_v2 = 0.0
    for held in range(folds):
        others = fold != held
        tables = fitted_tables(columns[others], penalty_of(), base[others])
        squares_v2 += np.sum((base + columns @ tables)[~others] ** 2)
    errors = held_out(objective, objective.solve(LOG_SCALES)).errors
    assert errors.rmse_v == pytest.approx(math.sqrt(squares_v2 / len(base)), rel=1e-8)
    assert errors.above_v == errors.rmse_v


@in_float64
def test_another_record_is_predicted_by_the_spread_of_those_there_are():
    records = [
        prepared_of(made_record(200, seed, interval_s=3.0, name=f"{seed}.csv")) for seed in range(3)
    ]
    objective = reduced_objective(records, replace(SETTINGS, folds=2), HELD)
    alone = np.array(
        [
            fitted_tables(columns, penalty_of(), base)
            for columns, base in (columns_of(prepared) for prepared in records)
        ]
    )
    at = 4 + 1
    assert all(prepared.nearest(np.array(NODES))[1] for prepared in records)
    joint = NodeInterval("R1 [Ohm]", NODES[1], 0.02, 1e-3, 0.0, 0.0199, 0.0201)
    (interval,) = with_spread(objective, objective.solve(LOG_SCALES), [joint])
    # Of one more draw from a normal distribution that three are known of.
    reach = student.ppf(0.975, 2) * np.std(alone[:, at], ddof=1) * math.sqrt(1 + 1 / 3)
    ends = np.mean(alone[:, at]) + reach * np.array([-1, 1])
    assert interval.record_low == pytest.approx(min(max(ends[0], 0.0), joint.low), rel=1e-8)
    assert interval.record_high == pytest.approx(max(ends[1], joint.high), rel=1e-8)
