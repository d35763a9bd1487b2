"""The compressed objective against the scan: one objective, two ways to compute it."""

from dataclasses import replace
from itertools import cycle, repeat

import equinox as eqx
import jax
import jax.numpy as jnp
import jax.random as jr
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from threadpoolctl import threadpool_limits

from barnax import Window, evaluate, make_optimizer, search_many, search_seeds
from barnax.cell import CIRCUITS, CircuitParameters
from barnax.model.prepared import BLOCK
from barnax.model.problem import Objective, make_problem, residuals, rmse, rmse_by_scan
from helpers.problems import CLOCKS, drive_record
from helpers.reference import banded_response, drop_v
from helpers.scan import rc_parameters

# What is promised: the larger of these, over the whole box.
RELATIVE, ABSOLUTE_V = 1e-9, 1e-12
KNOWN_SOC = Window(initial_soc=0.6)
# One length, so that few programs serve all.
SAMPLES = 403

rmse_of_all = eqx.filter_jit(jax.vmap(rmse, in_axes=(0, None)))


def points_in(box, count: int, seed: int):
    fractions = jr.uniform(jr.key(seed), (count, len(box.lower)), box.lower.dtype)
    # The ends of the box belong to it.
    fractions = jnp.concatenate([fractions, jnp.eye(len(box.lower)), 1 - jnp.eye(len(box.lower))])
    return box.lower + fractions * (box.upper - box.lower)


def rmses_of(points, objective):
    return np.asarray(rmse_of_all(points, objective))


def both_objectives(problem, scale="log"):
    """By the scan, and compressed."""
    problem = replace(problem, scale=scale)
    return [Objective(each, problem.coordinates) for each in (problem.scan, problem.compressed)]


def assert_both_agree(problem, scale="log"):
    with jax.enable_x64(True):
        scan, short = both_objectives(problem, scale)
        points = points_in(scan.coordinates, 20, 0)
        expected, actual = rmses_of(points, scan), rmses_of(points, short)
    np.testing.assert_allclose(actual, expected, rtol=RELATIVE, atol=ABSOLUTE_V)


def assert_compressed_is_the_reference(problem, seed=0):
    """Against a banded solve of every record, so that no scan is compiled."""
    with jax.enable_x64(True):
        short = both_objectives(problem)[1]
        points = points_in(short.coordinates, 20, seed)
        actual = rmses_of(points, short)
        rc = jax.tree.map(np.asarray, jax.vmap(short.coordinates.decode)(points))
    squares = np.zeros(len(points))
    for each in problem.prepared_records:
        for at in range(len(points)):
            circuit = rc.r0[at], [r[at] for r in rc.r], [tau[at] for tau in rc.tau]
            hold = each.record.hold.value
            drop = drop_v(banded_response, each.time_s, each.current_a, circuit, hold)
            error_v = (each.voltage_v - each.source_v + drop)[each.scored]
            squares[at] += error_v @ error_v
    expected = np.sqrt(squares / problem.scored)
    np.testing.assert_allclose(actual, expected, rtol=RELATIVE, atol=ABSOLUTE_V)


# Every circuit, each on another clock and hold; in raw R and C, one with and one without a state
# that moves.
CASES = [
    *zip(
        (*CIRCUITS, "1rc+diffusion"), cycle(CLOCKS), cycle(("forward", "backward")), repeat("log")
    ),
    ("so-rc", "gaps", "backward", "rc"),
    ("esc", "uneven", "backward", "rc"),
]
# Every clock, hold and scale, with a state that moves and without.
QUICK = [each for each in CASES if each[0] in ("so-rc", "3rc") or each[3] == "rc"]


@pytest.mark.parametrize(
    ("circuit", "clock", "hold", "scale"),
    [pytest.param(*each, marks=[] if each in QUICK else [pytest.mark.slow]) for each in CASES],
)
def test_every_circuit_in_the_box_has_the_scans_error(bundled_cell, circuit, clock, hold, scale):
    record = drive_record(clock, SAMPLES, seed=1, hold=hold)
    assert_both_agree(make_problem(record, bundled_cell, circuit, window=KNOWN_SOC), scale)


@settings(max_examples=4, suppress_health_check=[HealthCheck.too_slow])
@given(
    seed=st.integers(0, 10_000),
    clock=st.sampled_from(CLOCKS),
    hold=st.sampled_from(["forward", "backward"]),
    low=st.floats(0.05, 5.0),
    decades=st.floats(0.3, 4.0),
    scored_from_s=st.floats(0.0, 200.0),
    r1_ohm=st.none() | st.floats(0.01, 0.1),
)
def test_any_box_and_window_has_the_error_of_a_plain_simulation(
    bundled_cell, seed, clock, hold, low, decades, scored_from_s, r1_ohm
):
    tau = (low, low * 10**decades)
    problem = make_problem(
        drive_record(clock, SAMPLES, seed, hold),
        bundled_cell,
        "so-rc",
        window=replace(KNOWN_SOC, score_from_s=scored_from_s),
        bounds={"tau1 [s]": tau, "tau2 [s]": tau, "R0 [Ohm]": (1e-3, 1.0)},
        fixed={} if r1_ohm is None else {"R1 [Ohm]": r1_ohm},
    )
    assert_compressed_is_the_reference(problem, seed)


def test_a_record_longer_than_a_block_is_carried_across_its_edges(bundled_record, bundled_cell):
    window = Window(score_from_s=BLOCK - 50.5, score_to_s=2 * BLOCK + 50.5)
    problem = make_problem(bundled_record, bundled_cell, "so-rc", window=window)
    assert len(problem.prepared.soc) > 2 * BLOCK
    assert_compressed_is_the_reference(problem)


def test_a_record_of_fewer_samples_than_nodes_has_the_error_of_a_plain_simulation(bundled_cell):
    problem = make_problem(drive_record("uneven", 15, 8), bundled_cell, "so-rc", window=KNOWN_SOC)
    assert problem.scored < len(problem.compressed.in_tau.nodes)
    assert_compressed_is_the_reference(problem)


def test_records_reduced_together_have_their_joint_error(bundled_cell):
    records = [drive_record("uneven", 300, 2), drive_record("gaps", 400, 3, "backward")]
    problem = make_problem(records, bundled_cell, "so-rc", window=KNOWN_SOC)
    assert problem.scored == 700
    assert_compressed_is_the_reference(problem)
    assert_both_agree(problem)


def test_a_circuit_that_fits_perfectly_keeps_its_zero(bundled_cell):
    made = make_problem(drive_record("even", SAMPLES, 5), bundled_cell, "so-rc", window=KNOWN_SOC)
    circuit = CircuitParameters.constant(0.05, (0.03, 0.02), (300.0, 5000.0))
    exact_v = evaluate(made.prepared, circuit).simulated_v
    record = replace(made.prepared.record, voltage_v=exact_v)
    problem = make_problem(record, bundled_cell, "so-rc", window=KNOWN_SOC)
    with jax.enable_x64(True):
        short = both_objectives(problem)[1]
        point = short.coordinates.encode(rc_parameters(circuit))
        assert rmses_of(jnp.stack([point] * 30), short)[0] < ABSOLUTE_V
    assert rmse_by_scan(problem, [circuit])[0] < ABSOLUTE_V


def test_the_short_residuals_have_the_norm_and_the_slopes_of_the_long_ones(bundled_cell):
    problem = make_problem(drive_record("even", SAMPLES, 2), bundled_cell, "esc", window=KNOWN_SOC)
    with jax.enable_x64(True):
        slopes = eqx.filter_jit(jax.jacfwd(residuals))
        values = eqx.filter_jit(residuals)
        objectives = both_objectives(problem)
        point = points_in(objectives[0].coordinates, 1, 4)[0]
        normal, gradient = [], []
        for objective in objectives:
            jacobian = np.asarray(slopes(point, objective))
            normal.append(jacobian.T @ jacobian)
            gradient.append(jacobian.T @ np.asarray(values(point, objective)))
    np.testing.assert_allclose(normal[1], normal[0], rtol=1e-8, atol=1e-12 * np.max(normal[0]))
    np.testing.assert_allclose(gradient[1], gradient[0], rtol=1e-7, atol=1e-12)


def test_single_precision_agrees_to_its_rounding(bundled_cell):
    record = drive_record("even", SAMPLES, 5)
    problem = make_problem(record, bundled_cell, "so-rc", window=KNOWN_SOC)
    with jax.enable_x64(True):
        short = both_objectives(problem)[1]
        points = points_in(short.coordinates, 20, 3)
        expected = rmses_of(points, short)
    narrow, few = jax.tree.map(np.float32, (eqx.filter(short, eqx.is_array), points))
    single = rmses_of(jnp.asarray(few), eqx.combine(narrow, short))
    assert single.dtype == np.float32
    np.testing.assert_allclose(single, expected, rtol=2e-4, atol=1e-5)


@pytest.fixture(scope="module")
def compressed_problem(short_problem):
    return make_problem(
        short_problem.prepared.record,
        short_problem.cell,
        window=short_problem.prepared.window,
        objective="compressed",
    )


def test_a_compressed_search_has_the_same_bits_among_any_seeds_and_cells(
    compressed_problem, bundled_cell
):
    other = make_problem(
        drive_record("even", 1400, 9),
        bundled_cell,
        window=KNOWN_SOC,
        bounds=dict(compressed_problem.bounds.ranges),
        objective="compressed",
    )
    optimizer = make_optimizer("pso", 12, 40)
    together = search_many([other, compressed_problem, other], optimizer, key=jr.key(1), seeds=10)
    alone = search_seeds(compressed_problem, optimizer, key=jr.key(1), seeds=3)
    for many, one in zip(together[1].seeds, alone.seeds, strict=False):
        assert many.parameters == one.parameters
        assert many.rmse_v == one.rmse_v
    assert together[0].best.parameters == together[2].best.parameters


def test_reducing_gives_the_same_bits_whatever_the_threads_of_linear_algebra(short_problem):
    factors = set()
    for threads in (1, 4, 4):
        problem = replace(short_problem)
        with threadpool_limits(threads, "blas"):
            factors.add(np.asarray(problem.compressed.factor).tobytes())
    assert len(factors) == 1
