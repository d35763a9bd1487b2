"""What interactive figures are drawn from is what was measured, simulated and found."""

import base64

import numpy as np
import pytest

from barnax.plots.voltage import live_record
from helpers.results import make_evaluation, make_record


def columns_of(live):
    return [np.frombuffer(base64.b64decode(each), "<f4") for each in live["columns"]]


def test_a_record_is_held_whole_in_single_precision():
    evaluation = make_evaluation(make_record(600), np.arange(600) > 99)
    live = live_record({"simulated": evaluation})
    prepared = evaluation.prepared
    expected = (
        prepared.time_s - prepared.time_s[0],
        *(prepared.voltage_v, prepared.current_a, evaluation.simulated_v),
    )
    for held, own in zip(columns_of(live), expected, strict=True):
        np.testing.assert_array_equal(held, own.astype("f4"))
    assert live["origin"] == prepared.time_s[0]
    assert live["shaded"] == [[prepared.time_s[0], prepared.time_s[100]]]
    assert (live["samples"], live["held"]) == (600, 600)
    # Every panel shows its own columns.
    voltage, error, current = (panel["lines"] for panel in live["panels"])
    assert [line["column"] for line in (*voltage, *current)] == [1, 3, 2]
    assert [(line["column"], line["minus"]) for line in error] == [(1, 3)]


def test_of_a_long_record_no_peak_is_lost():
    samples, most = 50_000, 8_000
    error_v = np.random.default_rng(5).normal(0.0, 1e-3, samples)
    error_v[[1234, 44_444]] = 0.5, -0.4
    evaluation = make_evaluation(make_record(samples), error_v=error_v)
    live = live_record({"simulated": evaluation}, most)
    held = columns_of(live)
    assert live["samples"] == samples
    assert live["held"] == len(held[0]) <= most // 4
    assert (np.diff(held[0]) > 0).all()
    left_mv = 1e3 * (held[1] - held[3])
    assert left_mv.max() == pytest.approx(500, abs=0.01)
    assert left_mv.min() == pytest.approx(-400, abs=0.01)
    # A part as wide as one of those that the extremes are kept of has its extremes kept.
    parts = most // 4 // 10
    for own, kept in ((evaluation.prepared.current_a, held[2]), (error_v * 1e3, left_mv)):
        for part in range(parts):
            inside = slice(part * samples // parts + 2, (part + 1) * samples // parts - 2)
            time_s = evaluation.prepared.time_s[inside] - evaluation.prepared.time_s[0]
            here = (held[0] >= time_s[0] - 2) & (held[0] <= time_s[-1] + 2)
            assert kept[here].max() >= own[inside].max() - 1e-3
            assert kept[here].min() <= own[inside].min() + 1e-3
