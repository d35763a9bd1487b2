"""The statistics behind the benchmark pages, against closed forms and published tables."""

import numpy as np
import pytest
from benchmarks.li2023.table2 import statistics as table


def test_a_z_score_counts_standard_deviations_of_the_groups():
    groups = np.array([1.0, 2.0, 3.0])
    assert table.z_score(4.0, groups, in_log10=False) == 2.0
    assert table.z_score(1e4, 10.0**groups, in_log10=True) == pytest.approx(2.0)


def test_a_cell_agrees_only_on_both_scales():
    """Groups scattered near 1e-30 cannot stand for a printed 1e-90."""
    generator = np.random.default_rng(0)
    cells = [table.cell_of(10 ** generator.normal(-30, 0.5, 30)) for _ in range(10)]
    assert not table.agrees(table.scores("F1", table.Cell(1e-92, 1e-90, 1e-90), cells))
    near = np.mean([cell.mean for cell in cells])
    assert table.agrees(table.scores("F1", table.Cell(near, near, near), cells))
