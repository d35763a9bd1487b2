"""Starts, capacities and an offset of the current against dense algebra and a decision by hand."""

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from barnax.execution import in_float64
from barnax.over_soc import TableSettings, current_offset
from barnax.over_soc.current_offset import CurrentOffset, shared_offset
from barnax.over_soc.intervals import LIGHT
from barnax.over_soc.nuisances import Measured, estimate
from barnax.over_soc.problem import reduced_objective
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
    slopes_of,
)
from helpers.known_cell import ocv_v

PLAIN = TableSettings(nodes=NODES, folds=0, max_boxes=0, ocv_correction=False)
BOX = {"tau1 [s]": (4.0, 20.0), "tau2 [s]": (30.0, 100.0)}
LOG_SCALES = tuple(np.log(TAU_S).tolist())
OCV_NODES = (0.5, 0.6, 0.7, 0.8, 0.9)


@in_float64
@pytest.mark.parametrize("is_measured", [False, True])
def test_nuisances_are_the_dense_least_squares_of_everything_at_once(is_measured):
    prepared = prepared_of(made_record(), soc=0.905)
    objective = reduced_objective([prepared], PLAIN, BOX)
    best = objective.solve(LOG_SCALES, exact=True)
    slope = 0.7 + np.sin(prepared.time_s / 90)
    of_start = np.column_stack([slope, slope * (prepared.soc[0] - prepared.soc)])
    now, prior = np.array([2e-3, -1e-3]), np.array([4e-3, 1e-2])
    beside = Measured(np.array([[30.0, 5.0]]), np.array([0.8])) if is_measured else None
    wanted = np.zeros((1, 12))
    wanted[0, [1, 5, 9]] = 1.0
    (found,) = estimate(objective, best, lambda *_: of_start, now, [prior], wanted, beside)

    columns, base = columns_of(prepared, NODES, TAU_S)
    tables = [(NODES, CAPACITY_AH, PLAIN.resistance_ridge)] * 3
    penalty = penalty_of(PLAIN, tables, LIGHT)
    samples = len(base)
    light = fitted_tables(columns, penalty, base)
    error = base + columns @ light
    jacobian = np.hstack([columns, slopes_of(prepared, NODES, TAU_S, light), -of_start])
    noise_v2 = covariance_of(jacobian, error, prepared.time_s)
    unit = np.linalg.qr(jacobian)[0]
    weight = np.trace(unit.T @ noise_v2 @ unit) / 16 / samples
    # Of what is known, in standard deviations: by how much it moves, and by how much it is off.
    known, off = np.zeros((2, 16)), now / prior
    known[[0, 1], [14, 15]] = 1 / prior
    if is_measured:
        known, off = np.vstack([known, [0.0] * 14 + [30.0, 5.0]]), np.append(off, -0.8)
    penalty = np.pad(penalty, ((0, 0), (0, 4)))
    stiff = jacobian.T @ jacobian / samples + penalty.T @ penalty + weight * known.T @ known
    pushes = jacobian.T @ error / samples + weight * known.T @ off
    moved = np.linalg.solve(stiff, pushes)
    by_noise = np.linalg.solve(stiff, jacobian.T / samples)
    by_known = np.linalg.solve(stiff, weight * known.T)
    covariance = by_noise @ noise_v2 @ by_noise.T + by_known @ by_known.T
    total = np.pad(wanted, ((0, 0), (0, 4)))[0]
    np.testing.assert_allclose(found.values, now - moved[14:], rtol=1e-7)
    np.testing.assert_allclose(found.covariance, covariance[14:, 14:], rtol=1e-7)
    np.testing.assert_allclose(found.moved_scales, -moved[12:14], rtol=1e-6)
    assert found.sums[0] == pytest.approx(wanted[0] @ light - total @ moved, rel=1e-8)
    assert found.sum_errors[0] == pytest.approx(math.sqrt(total @ covariance @ total), rel=1e-8)
    np.testing.assert_allclose(found.by_prior[:2], by_known[14:, :2], rtol=1e-7)
    misfit = off @ off - pushes @ moved / weight
    evidence = -(misfit + np.linalg.slogdet(stiff)[1]) / 2 - np.log(prior).sum()
    assert found.log_evidence == pytest.approx(evidence, rel=1e-7)


@in_float64
def test_an_offset_adds_its_charge_along_the_ocv_and_its_drop_over_all_resistances():
    records = [prepared_of(made_record(noise_v=0.0)), prepared_of(made_record(seed=1, scale=0.5))]
    settings = replace(PLAIN, ocv_correction=True, ocv_nodes=OCV_NODES)
    moved = current_offset._Moved(records, settings, np.zeros((2, 2)), 0.0)
    objective = moved.objective({name: (tau, tau) for name, tau in zip(BOX, TAU_S, strict=True)})
    best = objective.solve(LOG_SCALES)
    prepared = objective.prepared_records[1]
    nodes, own_v = objective.ocv_at(best)
    columns = current_offset._of_starts_and_offset(objective, best, 1)
    for soc, time_s, row in zip(prepared.soc, prepared.time_s, columns, strict=True):
        middle = min(max(soc, nodes[0] + 0.01), nodes[-1] - 0.01)
        slope = np.diff(np.interp([middle - 0.01, middle + 0.01], nodes, own_v))[0] / 0.02
        ohm = sum(np.interp(soc, NODES, table) for table in best.values[:3])
        own = slope, slope * (prepared.soc[0] - soc)
        by_offset = slope * time_s / 3600 / CAPACITY_AH + ohm
        np.testing.assert_allclose(row, [0.0, 0.0, *own, by_offset], rtol=1e-9, atol=1e-12)
    assert own_v[-1] - own_v[0] == pytest.approx(ocv_v(0.9) - ocv_v(0.5), rel=0.1)


@pytest.mark.parametrize(
    ("offset", "error", "left", "is_told"),
    [
        # In shares of the capacity per hour; what is left in shares of the error without it.
        (0.01, 0.001, 0.8, True),
        (-0.01, 0.001, 0.8, True),
        (0.01, 0.001, 0.849, True),
        (0.01, 0.001, 0.851, False),
        (0.0034, 0.0001, 0.5, True),
        (0.0033, 0.0001, 0.5, False),
        (0.01, 0.0033, 0.5, True),
        (0.01, 0.0034, 0.5, False),
        (0.05, 0.0076, 0.5, False),
        (0.05, 0.0074, 0.5, True),
    ],
)
def test_an_offset_is_told_by_its_size_its_error_and_what_it_leaves(
    monkeypatch, offset, error, left, is_told
):
    capacity_ah, without_v = 2.0, 4e-3
    record = SimpleNamespace(capacity_ah=capacity_ah)
    axis = SimpleNamespace(low=0.0, high=9.0)
    best = SimpleNamespace(log_scales=(1.0, 3.0), objective_v2=1.0, rms_v=left * without_v)
    objective = SimpleNamespace(
        prepared_records=[record, record], axes=[axis, axis], settings=PLAIN, ranges=BOX
    )
    estimated = SimpleNamespace(
        values=np.array([0.0] * 4 + [offset * capacity_ah]),
        errors=np.array([1e-3] * 4 + [error * capacity_ah]),
        moved_scales=np.zeros(2),
    )
    solved = SimpleNamespace(solve=lambda scales: best, ranges=BOX)
    monkeypatch.setattr(current_offset, "reads_zero_at_rest", lambda record: False)
    monkeypatch.setattr(current_offset._Moved, "objective", lambda moved, ranges: solved)
    monkeypatch.setattr(current_offset, "estimate", lambda *_: [estimated])
    found = shared_offset(objective, best, np.full((2, 2), 3e-3), without_v)
    expected = CurrentOffset(offset * capacity_ah, error * capacity_ah)
    assert found == (expected if is_told else None)
