"""Seeds are independent and repeat to the bit, and what they find is right.

Searches have the shape of the short problem wherever they can, so they share its programs.
"""

import jax
import numpy as np
import pytest

from barnax import InputError, refine, search_seeds
from barnax.search.answers import AtBound
from helpers.problems import other_problem
from helpers.reference import drop_v, filtered_response

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


def bits(answer):
    """All that a seed found, bit for bit."""
    return answer.rmse_v, answer.parameters, answer.evaluations


@pytest.fixture(scope="module")
def search(short_problem, searched):
    """Searches on the short problem, with the optimizer of `found` and its compiled program."""

    def run(key=0, seeds=8, problem=short_problem, **options):
        return search_seeds(
            problem, searched.optimizer, key=jax.random.key(key), seeds=seeds, **options
        )

    return run


@pytest.mark.parametrize("is_double", [False, True])
def test_the_same_key_gives_the_same_bits_in_any_callers_precision(search, searched, is_double):
    with jax.enable_x64(is_double):
        again = search()
        assert jax.config.jax_enable_x64 is is_double
    assert [bits(seed) for seed in again.seeds] == [bits(seed) for seed in searched.seeds]


def test_a_seed_searches_alone_and_is_the_same_among_any_number_of_seeds(search, searched):
    many = search(seeds=20)
    assert len({seed.rmse_v for seed in many.seeds}) == 20
    assert [bits(seed) for seed in many.seeds[:8]] == [bits(seed) for seed in searched.seeds]
    assert bits(search(seeds=3).seeds[2]) == bits(searched.seeds[2])
    assert bits(search(seeds=13).seeds[12]) == bits(many.seeds[12])


def test_every_evaluation_is_counted(searched):
    assert searched.best.rmse_v == min(seed.rmse_v for seed in searched.seeds)
    # The first population and one of each generation, 12 candidates each.
    assert [seed.evaluations for seed in searched.seeds] == [12 * (40 + 1)] * 8
    assert searched.evaluations == 8 * 12 * 41
    assert [seed.failures for seed in searched.seeds] == [0] * 8


def test_many_blocks_finish_in_the_order_of_the_seeds_and_progress_sums_to_them(search, searched):
    # More blocks than cores, so that some wait while others run.
    steps = []
    many = search(seeds=80, progress=steps.append)
    assert len(many.seeds) == sum(steps) == 80
    assert [bits(seed) for seed in many.seeds[:8]] == [bits(seed) for seed in searched.seeds]


# Known circuits found again


@pytest.fixture(scope="module")
def checked_on(short_problem, searched):
    """Search and refinement on the bundled current with another voltage."""

    def run(circuit, voltage_v):
        problem = other_problem(short_problem, circuit, voltage_v)
        return refine(search_seeds(problem, searched.optimizer, key=jax.random.key(0), seeds=8))

    return run


def made_voltage_v(prepared, cell, row, seed):
    """The terminal voltage of a row of Table 3 on the record's current, with noise."""
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
    refinement = checked_on(row[0], voltage_v)
    _, r0, r1, r2, c1, c2 = row
    recovered = np.array(list(refinement.parameters.to_dict().values()))
    misses = np.log(recovered / [r0, r1, c1, r2, c2]) / standard_errors(prepared.current_a, row)
    assert np.abs(misses).max() < 4.5
    assert refinement.at_bound == ()
    # Five parameters fitted to 1,501 samples leave the noise, within 5 of its standard errors.
    assert refinement.rmse_v == pytest.approx(NOISE_V, rel=5 / np.sqrt(2 * 1501))


def test_a_pair_far_faster_than_the_sampling_is_reported_at_its_bound(checked_on, short_problem):
    voltage_v = made_voltage_v(short_problem.prepared, short_problem.cell, TOO_FAST, seed=20)
    refinement = checked_on("so-rc", voltage_v)
    _, r0, r1, r2, _, c2 = TOO_FAST
    actual = refinement.parameters
    assert AtBound("tau1 [s]", "lower") in refinement.at_bound
    assert (actual.r0 + actual.r[0]) == pytest.approx(r0 + r1, rel=5e-3)
    assert (actual.r[1], actual.c[1]) == pytest.approx((r2, c2), rel=5e-3)


def test_a_name_is_no_optimizer(short_problem):
    with pytest.raises(InputError, match=r"^`optimizer` 'pso' is no optimizer; .*make_optimizer"):
        search_seeds(short_problem, "pso", key=jax.random.key(0))
