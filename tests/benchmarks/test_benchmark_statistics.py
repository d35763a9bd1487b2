"""The statistics behind the benchmark pages, against closed forms and published tables."""

import numpy as np
import pytest
from benchmarks.design.virtual import SHARES, TABLES, virtual_lines
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


class Alike(dict):
    """A row in which all that was measured is one, but what is said."""

    def __missing__(self, _):
        return 1.0


def test_a_designed_test_is_compared_with_an_hppc_that_has_the_drive_cycle_too():
    """One of four cells is worse than that HPPC; all are better than one without the drive."""
    test = f"{SHARES[0]} known"
    alone = {f"{name} hppc": 2.0 for name in ("v", *TABLES)}
    rows = [Alike(alone), Alike(alone), Alike(alone), Alike(alone | {f"v {test}": 1.2})]
    lines = virtual_lines(rows)
    (terms,) = (line for line in lines if line.startswith("On equal terms"))
    assert terms.endswith(
        "no wider than HPPC's in 100 % of the cells, an error no larger in 75 %, both in 75 %, and "
        "an error up to 1.1 times as large in 75 %."
    )
    assert "| all: error no larger than HPPC's with the drive | 75 % | 100 % | 100 % |" in lines
    assert "| all: error no larger than HPPC's without the drive | 100 % | 100 % | 100 % |" in lines
