"""Whether 95 % intervals hold known truths in 95 % of simulated records."""

import importlib
from pathlib import Path

import pytest

from .made import TRUTH

REPOSITORY = Path(__file__).parents[2]


@pytest.fixture
def benchmark(monkeypatch):
    monkeypatch.syspath_prepend(str(REPOSITORY))
    return importlib.import_module("benchmarks.coverage")


def test_intervals_hold_the_truth_under_correlated_noise_where_plain_ones_do_not(
    benchmark, short_problem
):
    # Of 60 records 57 are expected to hold one parameter; fewer than 50 do once in 3,000 times.
    noise = benchmark.Noise("12 s", ((12.0, 2e-3),))
    found = benchmark.coverage(short_problem, TRUTH, noise, records=60, seed=11)
    assert min(found.trusted.values()) >= 50 / 60
    assert max(found.plain.values()) < 0.8
    assert min(found.inflation.values()) > 1.5


@pytest.mark.slow
@pytest.mark.parametrize("noise", range(4))
def test_intervals_of_200_long_records_hold_90_to_98_percent(benchmark, noise):
    problem = benchmark.bundled("so-rc")
    found = benchmark.coverage(
        problem, benchmark.CIRCUITS[0], benchmark.NOISES[noise], records=200, seed=20
    )
    # The shares themselves are to lie between 90 and 98 %; 200 records show them to 1 or 2 %.
    assert min(found.trusted.values()) >= 0.90 - 0.01
    assert max(found.trusted.values()) <= 0.98 + 0.01
