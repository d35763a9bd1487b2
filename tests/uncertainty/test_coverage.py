"""Whether 95 % intervals hold known truths in 95 % of simulated records."""

import importlib
from itertools import product
from pathlib import Path

import numpy as np
import pytest

REPOSITORY = Path(__file__).parents[2]
# Under two noises at once, one of 600 s, of 200 records: benchmarks/results/coverage.md.
OFF = {
    (0, 3): "intervals of R2 hold the truth in 99.5 %",
    (1, 3): "beside tau2 = 87 s, intervals of R1 and tau1 hold the truth in 87 and 88 %",
}


@pytest.fixture
def benchmark(monkeypatch):
    monkeypatch.syspath_prepend(str(REPOSITORY))
    return importlib.import_module("benchmarks.coverage.simulated")


@pytest.mark.slow
@pytest.mark.parametrize("circuit", [0, 1])
def test_intervals_hold_the_truth_under_correlated_noise_where_plain_ones_do_not(
    benchmark, short_problem, circuit
):
    noise = benchmark.Noise("12 s", ((12.0, 2e-3),))
    truth = benchmark.CIRCUITS[circuit]
    actual = benchmark.coverage(short_problem, truth, noise, records=60, seed=11)
    # Of 60 records 57 are expected to hold one parameter; so few do less than once in 1,000 times.
    low, _ = benchmark.chance_band(60)
    assert low == 50 / 60
    assert min(actual.trusted.values()) >= low
    assert max(actual.plain.values()) < low
    assert min(actual.inflation.values()) > 1.5
    assert set(actual.open.values()) == {0}


def test_an_open_interval_counts_as_open_and_not_as_one_that_holds_the_truth(
    benchmark, short_problem
):
    # Under noise of 1 V nothing of a circuit of some 10 mV shows.
    noise = benchmark.Noise("1 V", ((12.0, 1.0),))
    actual = benchmark.coverage(short_problem, benchmark.CIRCUITS[1], noise, records=5, seed=3)
    assert sum(actual.open.values()) > 0
    for name, opened in actual.open.items():
        assert actual.trusted[name] <= 1 - opened / 5


def test_the_band_is_that_of_the_binomial_distribution(benchmark):
    low, high = benchmark.chance_band(200)
    hits = np.random.default_rng(0).binomial(200, 0.95, 1_000_000) / 200
    assert np.mean((hits < low) | (hits > high)) < 1.1e-3
    assert np.mean((hits <= low) | (hits >= high)) > 0.9e-3
    # Which is how closely 200 records can tell 95 % from the 90 and 98 % that are allowed.
    assert (low, high) == (0.895, 0.99)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("circuit", "noise"),
    [
        pytest.param(
            *case, marks=pytest.mark.xfail(strict=True, reason=OFF[case]) if case in OFF else ()
        )
        for case in product(range(2), range(4))
    ],
)
def test_intervals_of_200_long_records_hold_95_percent_of_truths_but_for_chance(
    benchmark, circuit, noise
):
    problem = importlib.import_module("benchmarks.coverage.cells").bundled("so-rc")
    case = benchmark.CIRCUITS[circuit], benchmark.NOISES[noise]
    actual = benchmark.coverage(problem, *case, records=200, seed=20)
    # 89.5 to 99 %: of 7 parameters in 8 cases each, chance alone leaves the band once in 18 runs.
    low, high = benchmark.chance_band(200)
    assert min(actual.trusted.values()) >= low
    assert max(actual.trusted.values()) <= high
