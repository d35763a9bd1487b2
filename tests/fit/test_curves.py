"""The curves behind tables, against best lines along known ones and a cell whose R bends."""

import numpy as np
import pytest

from barnax import TableSettings, Window
from barnax.cell.parameters import OCV
from barnax.cell.tables import hats
from barnax.fit.table_curves import TableCurve, chord_offset
from barnax.settings import NODES
from helpers.fitted_ocv import fit_with_ocv
from helpers.made_cell import R0_OHM, made, ocv_v

INSIDE = np.array([node for node in NODES if 0 <= node <= 1])


@pytest.mark.parametrize("width", [0.08, 0.12, 0.3])
def test_a_curve_follows_from_the_best_lines_along_it(width):
    def curve(soc):
        return 1 + np.exp(-soc / width)

    soc = np.linspace(0, 1, 20001)
    values = np.linalg.lstsq(hats(soc, INSIDE), curve(soc))[0]
    truth, sags = curve(INSIDE) - values, chord_offset(INSIDE, values)
    np.testing.assert_allclose(sags, truth, atol=0.08 * np.max(np.abs(truth)))
    between = TableCurve(INSIDE, values, sags).above_lines(soc) + np.interp(soc, INSIDE, values)
    off = np.abs(between - curve(soc))
    assert np.max(off) < 0.25 * np.max(np.abs(np.interp(soc, INSIDE, values) - curve(soc)))


def test_intervals_of_the_ocv_hold_where_resistances_bend():
    capacity_ah = 2.0

    def bend(soc):
        return 1 + 1.2 * np.exp(-soc / 0.12)

    def driven(time_s, current_a):
        out_ah = np.append(0.0, np.cumsum(current_a[:-1] * np.diff(time_s))) / 3600
        bent_a = bend(1 - out_ah / capacity_ah) * current_a
        return None, bent_a, bent_a

    record, soc = made(hours=3.1, driven=driven)
    assert soc.min() < 0.08
    window = {record.name: Window(initial_soc=1.0, capacity_ah=capacity_ah)}
    fit = fit_with_ocv([record], "so-rc", window, TableSettings(folds=0, max_boxes=0)).fit
    for name, truth in ((OCV, ocv_v), ("R0 [Ohm]", lambda soc: R0_OHM * bend(soc))):
        nodes = [each for each in fit.intervals if each.name == name and 0.1 <= each.soc <= 0.5]
        assert np.mean([each.low <= truth(each.soc) <= each.high for each in nodes]) >= 0.9
