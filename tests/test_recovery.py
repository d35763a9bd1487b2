"""Whether the answers are right: known circuits found again, and SciPy's own fit met.

All problems have the shape of the short problem, so they share its compiled programs.
"""

from dataclasses import replace

import jax
import numpy as np
import pytest

from barnax.model.inputs import Window
from barnax.model.problem import make_problem
from barnax.search.refine import refine
from barnax.search.seeds import search_seeds
from reference import banded_response, drop_v, filtered_response, fit_circuit

# Li et al. (2023), Table 3: R, Rpa, Rpb in ohm, Cpa, Cpb in farad, and the circuit it was for.
TABLE_3 = {
    "LS": ("so-rc", 0.0285, 0.0395, 0.0412, 28.63, 415.76),
    "PSO": ("so-rc", 0.0356, 0.0322, 0.0485, 33.14, 390.87),
    "BMO-ISO": ("iso-rc", 0.0316, 0.0399, 0.0401, 30.23, 469.93),
    "IBMO-ISO": ("iso-rc", 0.0301, 0.0347, 0.0434, 20.00, 377.04),
}
# The remaining row's first pair, 0.0996 s, is a resistor to a record of 1 s.
TOO_FAST = ("so-rc", 0.0334, 0.0023, 0.0503, 43.31, 488.57)
NOISE_V = 1e-3


@pytest.fixture(scope="module")
def checked_on(short_problem, found):
    """Search and cross-check on the bundled current with another voltage, or another circuit."""

    def run(circuit, voltage_v=None, bounds=None):
        record, prepared = short_problem.prepared.record, short_problem.prepared
        if voltage_v is not None:
            whole_v = record.voltage_v.copy()
            whole_v[prepared.span] = voltage_v
            record = replace(record, voltage_v=whole_v)
        window = Window(initial_soc=prepared.initial_soc, score_to_s=1500.5)
        problem = make_problem(record, short_problem.cell, circuit, window=window, bounds=bounds)
        answer = search_seeds(problem, found.optimizer, key=jax.random.key(0), seeds=8)
        return problem, refine(answer)

    return run


def made_voltage_v(prepared, cell, row, seed):
    """The terminal voltage of a row of Table 3 on the course's current, with noise."""
    circuit, r0, r1, r2, c1, c2 = row
    source_v = cell.average_ocv_v(prepared.soc)
    if circuit == "iso-rc":
        source_v = source_v + prepared.direction * cell.hysteresis_v(prepared.soc) / 2
    pairs = (r1, r2), (r1 * c1, r2 * c2)
    drop = drop_v(filtered_response, 1.0, prepared.current_a, (r0, *pairs))
    return source_v - drop + np.random.default_rng(seed).normal(0, NOISE_V, len(drop))


def standard_errors(current_a, row):
    """Least standard deviation of ln R0, R1, C1, R2, C2 that 1 mV of noise allows (Cramer-Rao)."""
    _, r0, r1, r2, c1, c2 = row
    logarithms, step = np.log([r0, r1, c1, r2, c2]), 1e-6
    slopes = []
    for index in range(5):
        ends = []
        for sign in (-1, 1):
            r0, r1, c1, r2, c2 = np.exp(logarithms + sign * step * np.eye(5)[index])
            pairs = (r1, r2), (r1 * c1, r2 * c2)
            ends.append(drop_v(filtered_response, 1.0, current_a, (r0, *pairs)))
        slopes.append((ends[1] - ends[0]) / (2 * step))
    information = np.array(slopes) @ np.transpose(slopes) / NOISE_V**2
    return np.sqrt(np.diag(np.linalg.inv(information)))


# 20 normal errors in all: the largest is beyond 4.5 standard deviations once in 7,000 draws.
@pytest.mark.parametrize("name", TABLE_3)
def test_a_circuit_of_table_3_is_recovered_as_well_as_the_noise_allows(
    name, checked_on, short_problem
):
    row, prepared = TABLE_3[name], short_problem.prepared
    voltage_v = made_voltage_v(prepared, short_problem.cell, row, seed=20)
    _, refinement = checked_on(row[0], voltage_v)
    _, r0, r1, r2, c1, c2 = row
    recovered = np.array(list(refinement.parameters.to_dict().values()))
    misses = np.log(recovered / [r0, r1, c1, r2, c2]) / standard_errors(prepared.current_a, row)
    assert np.abs(misses).max() < 4.5
    assert refinement.at_bound == ()
    # Five parameters fitted to 1,501 samples leave the noise, within 5 of its standard errors.
    assert refinement.rmse_v == pytest.approx(NOISE_V, rel=5 / np.sqrt(2 * 1501))


def test_a_pair_far_faster_than_the_sampling_is_reported_at_its_bound(checked_on, short_problem):
    voltage_v = made_voltage_v(short_problem.prepared, short_problem.cell, TOO_FAST, seed=20)
    _, refinement = checked_on("so-rc", voltage_v)
    _, r0, r1, r2, _, c2 = TOO_FAST
    found = refinement.parameters
    assert "tau1 [s] at its lower bound" in refinement.at_bound
    assert (found.r0 + found.r[0]) == pytest.approx(r0 + r1, rel=5e-3)
    assert (found.r[1], found.c[1]) == pytest.approx((r2, c2), rel=5e-3)


# The best R0 is 58 mohm: the narrow range puts the optimum on its upper end.
@pytest.mark.parametrize("r0_ohm", [None, (0.02, 0.05)])
@pytest.mark.parametrize("circuit", ["iso-rc", "so-rc"])
def test_scipy_finds_the_same_optimum_on_the_bundled_cell(circuit, r0_ohm, checked_on):
    problem, refinement = checked_on(circuit, bounds=r0_ohm and {"R0 [Ohm]": r0_ohm})
    prepared, cell = problem.prepared, problem.cell
    current_a, soc = prepared.current_a, prepared.initial_soc
    soc = soc - np.append(0.0, np.cumsum(current_a[:-1])) / 3600 / cell.capacity_ah
    source_v = cell.average_ocv_v(soc)
    if circuit == "iso-rc":
        moved = np.where(np.abs(current_a) > 0.02, -np.sign(current_a), 0.0)
        last = np.maximum.accumulate(np.where(moved != 0, np.arange(len(moved)), 0))
        source_v = (
            source_v + np.where(moved[last] == 0, 1.0, moved[last]) * cell.hysteresis_v(soc) / 2
        )

    def drop_of(*values):
        return drop_v(filtered_response, 1.0, current_a, values)

    low, high = (end * 2.0 / cell.capacity_ah for end in (1e-4, 0.2))
    r0_low, r0_high = r0_ohm or (low, high)
    rmse_v, (r0, r1, r2, tau1, tau2) = fit_circuit(
        drop_of,
        source_v - prepared.voltage_v,
        np.ones(len(soc), bool),
        [r0_low, low, low, 0.5, 0.5],
        [r0_high, high, high, 1500.0, 1500.0],
        starts=8,
    )
    assert refinement.rmse_v == pytest.approx(rmse_v, rel=1e-6)
    expected = [r0, r1, tau1 / r1, r2, tau2 / r2]
    assert list(refinement.parameters.to_dict().values()) == pytest.approx(expected, rel=1e-3)


def test_the_two_references_agree():
    time_s = np.arange(200.0)
    current_a = np.sin(time_s / 7)
    for hold in ("forward", "backward"):
        banded = banded_response(time_s, current_a, 5.0, hold)
        filtered = filtered_response(1.0, current_a, 5.0, hold)
        np.testing.assert_allclose(banded, filtered, atol=1e-13)
