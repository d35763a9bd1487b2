"""Decimation must not be seen."""

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from sample_results import make_evaluation, make_record

from barnax.plots import plot_error, plot_voltage
from barnax.plots.style import decimate


def test_a_short_record_keeps_every_sample():
    x = np.arange(40.0)
    np.testing.assert_array_equal(decimate(x, np.sin(x), columns=10), np.arange(40))


@given(st.integers(0, 2**32 - 1), st.integers(1, 30), st.integers(121, 600))
def test_every_column_keeps_its_extremes_and_ends(seed, columns, samples):
    random = np.random.default_rng(seed)
    x = np.cumsum(random.exponential(size=samples))
    y = random.normal(size=samples)
    kept = decimate(x, y, columns)
    edges = np.linspace(x[0], x[-1], columns + 1)
    for left, right in itertools.pairwise(edges):
        # Samples within rounding of an edge may belong to either side.
        inside = np.flatnonzero((x > left + 1e-9) & (x < right - 1e-9))
        if len(inside) == 0:
            continue
        among = kept[(x[kept] > left - 1e-9) & (x[kept] < right + 1e-9)]
        assert y[among].min() <= y[inside].min()
        assert y[among].max() >= y[inside].max()
    assert (kept[0], kept[-1]) == (0, samples - 1)
    assert len(kept) <= 4 * columns


@pytest.mark.parametrize("plot", [plot_voltage, plot_error])
def test_a_long_record_is_drawn_with_few_points(plot):
    random = np.random.default_rng(0)
    evaluation = make_evaluation(make_record(200_000), error_v=random.normal(size=200_000))
    lines = [line for line in plot(evaluation).axes[0].get_lines() if len(line.get_xdata()) > 2]
    assert lines
    assert all(len(line.get_xdata()) <= 8000 for line in lines)
    highest = (
        evaluation.error_v.max() if plot is plot_error else evaluation.prepared.voltage_v.max()
    )
    drawn = max(np.nanmax(line.get_ydata()) for line in lines)
    assert drawn >= highest
