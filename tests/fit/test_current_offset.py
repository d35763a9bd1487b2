"""An offset of the current: its column, and the decision, by hand."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from barnax.execution import in_float64
from barnax.fit import current_offset
from barnax.fit.current_offset import OPEN_PER_H, shared_offset
from helpers.dense import (
    BOX,
    CAPACITY_AH,
    LOG_SCALES,
    NODES,
    SETTINGS,
    TAU_S,
    made_record,
    prepared_of,
)
from helpers.made_cell import ocv_v

OCV_NODES = (0.5, 0.6, 0.7, 0.8, 0.9)


@in_float64
def test_an_offset_adds_its_charge_along_the_ocv_and_its_drop_over_all_resistances():
    records = [prepared_of(made_record(noise_v=0.0)), prepared_of(made_record(seed=1, scale=0.5))]
    settings = replace(SETTINGS, ocv_correction=True, ocv_nodes=OCV_NODES)
    given = SimpleNamespace(prepared_records=records, settings=settings)
    held = {name: (tau, tau) for name, tau in zip(BOX, TAU_S, strict=True)}
    objective = current_offset._without_offset(given, np.zeros((2, 2)), 0.0, held)
    best = objective.solve(LOG_SCALES)
    prepared = objective.prepared_records[1]
    nodes, own_v = objective.ocv_at(best)
    columns = current_offset._of_starts_and_offset(objective, best, 1)
    for soc, time_s, row in zip(prepared.soc, prepared.time_s, columns, strict=True):
        middle = min(max(soc, nodes[0] + 0.01), nodes[-1] - 0.01)
        slope = np.diff(np.interp([middle - 0.01, middle + 0.01], nodes, own_v))[0] / 0.02
        ohm = sum(np.interp(soc, NODES, table) for table in best.values[:3])
        by_start = slope, slope * (prepared.soc[0] - soc)
        by_offset = slope * time_s / 3600 / CAPACITY_AH + ohm
        np.testing.assert_allclose(row, [0.0, 0.0, *by_start, by_offset], rtol=1e-9, atol=1e-12)
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
        # Right at one that is tried, with time constants of none.
        (0.015, 0.001, 0.5, True),
    ],
)
def test_an_offset_is_reported_by_its_size_its_error_and_what_it_leaves(
    monkeypatch, offset, error, left, is_told
):
    capacity_ah, without_v = 2.0, 4e-3
    record = SimpleNamespace(capacity_ah=capacity_ah)
    best = SimpleNamespace(log_scales=(1.0, 3.0), objective_v2=1.0, rms_v=left * without_v)
    objective = SimpleNamespace(prepared_records=[record, record], settings=SETTINGS, ranges=BOX)
    estimated = SimpleNamespace(
        values=np.array([0.0] * 4 + [offset * capacity_ah]),
        errors=np.array([1e-3] * 4 + [error * capacity_ah]),
        moved_scales=np.zeros(2),
    )
    polished = []

    def without_offset(objective, shifts, offset_a, ranges):
        # The largest that is tried leaves least.
        left = SimpleNamespace(**{**vars(best), "objective_v2": 1 - abs(offset_a)})
        return SimpleNamespace(solve=lambda scales: left, ranges=ranges)

    def polish(objective, start):
        polished.append(objective.ranges)
        return start

    monkeypatch.setattr(current_offset, "search_ranges", lambda *_: BOX)
    monkeypatch.setattr(current_offset, "polish", polish)
    monkeypatch.setattr(current_offset, "reads_zero_at_rest", lambda record: False)
    monkeypatch.setattr(current_offset, "_without_offset", without_offset)
    monkeypatch.setattr(current_offset, "estimate", lambda *_: [estimated])
    offset_found = shared_offset(objective, best, np.full((2, 2), 3e-3), without_v)
    expected = offset * capacity_ah, error * capacity_ah
    assert offset_found == (expected if is_told else None)
    # Once, with time constants free.
    assert polished == [BOX] or (not polished and error > OPEN_PER_H)
