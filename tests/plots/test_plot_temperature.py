"""The figures of tables over SOC and temperature: a line a temperature, and what is between."""

from dataclasses import replace

import numpy as np
import pytest

from barnax.over_soc import OverTemperature, TableFits
from barnax.plots import plot_over_temperature, plot_tables_by_temperature
from helpers.results import NODES, TABLE_OHM, make_fit

DEGC = (0.0, 20.0, 40.0)


@pytest.fixture(scope="module")
def found() -> TableFits:
    fit = make_fit()
    fits = []
    for factor in (2.0, 1.0, 0.5):
        r0, *r = (tuple(factor * np.array(each)) for each in TABLE_OHM)
        tables = replace(fit.tables, r0_ohm=r0, r_ohm=tuple(r))
        fits.append(replace(fit, tables=tables))
    return TableFits(tuple(fits), OverTemperature(DEGC, 1e-3, 1e-3, 1e-3, (), ()))


def line(axes, label):
    (found,) = [each for each in axes.get_lines() if each.get_label() == label]
    return found


def test_each_temperature_is_a_line_through_its_visited_nodes(found):
    axes = plot_tables_by_temperature(found).axes[0]
    assert axes.get_ylabel() == "R0 [mOhm]"
    own = line(axes, "0 degC")
    np.testing.assert_allclose(own.get_xdata(), NODES[2:])
    np.testing.assert_allclose(own.get_ydata(), 2e3 * np.array(TABLE_OHM[0][2:]))


def test_between_temperatures_stands_what_is_interpolated(found):
    figure = plot_over_temperature(found)
    assert [axes.get_ylabel() for axes in figure.axes] == ["R0 [mOhm]", "R1 [mOhm]", "R2 [mOhm]"]
    place = int(np.argmin(np.abs(np.array(NODES) - 0.5)))
    course = line(figure.axes[0], f"SOC {100 * NODES[place]:g} %")
    ends = 1e3 * TABLE_OHM[0][place] * np.array([2.0, 0.5])
    assert course.get_ydata()[[0, -1]] == pytest.approx(ends)
    # A quarter of the way in 1/T from 0 to 20 degC is a quarter of the way in log R.
    kelvin = 1 / (0.75 / 273.15 + 0.25 / 293.15)
    there = np.interp(kelvin - 273.15, course.get_xdata(), course.get_ydata())
    assert there == pytest.approx(ends[0] / 2**0.25, rel=1e-3)
    assert found.at(18.0) == found.fits[1].tables
