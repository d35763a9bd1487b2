"""The figures of tables over SOC and temperature: nodes, bands, what is between, errors by cell."""

from dataclasses import replace

import numpy as np
import pytest

from barnax.cell.parameters import OCV
from barnax.fit.intervals import NodeInterval
from barnax.fit.temperature_fits import OverTemperature, TableFits
from barnax.plots import plot_over_temperature, plot_tables
from helpers.results import NODES, TABLE_OHM, line, make_fit

SOCS = (0.1, 0.5, 0.9)


def test_an_ocv_identified_from_the_record_has_a_panel_too():
    fit = make_fit()
    own = [NodeInterval(OCV, soc, 3.0 + soc, 0.01, 0.0, 2.9 + soc, 3.1 + soc) for soc in SOCS]
    axes = plot_tables(replace(fit, intervals=(*fit.intervals, *own))).axes[-1]
    assert axes.get_ylabel() == "OCV [V]"
    np.testing.assert_allclose(line(axes, "node").get_ydata(), [3.0 + soc for soc in SOCS])
    low, high = axes.get_ylim()
    assert 2.7 < low < 2.9 + SOCS[0]
    assert 3.1 + SOCS[-1] < high < 4.3


def test_visited_nodes_are_filled_with_a_band_and_the_others_hollow():
    axes = plot_tables(make_fit()).axes[0]
    visited, others = line(axes, "node"), line(axes, "node without samples")
    np.testing.assert_allclose(visited.get_xdata(), NODES[2:])
    np.testing.assert_allclose(visited.get_ydata(), 1e3 * np.array(TABLE_OHM[0][2:]))
    np.testing.assert_allclose(others.get_xdata(), NODES[:2])
    assert others.get_markerfacecolor() == "white"
    assert visited.get_markerfacecolor() != "white"
    (band,) = [each for each in axes.collections if each.get_label() == "95 % interval"]
    points = band.get_paths()[0].vertices
    assert points[:, 0].min() == pytest.approx(NODES[2])
    assert points[:, 1].max() == pytest.approx(1e3 * (max(TABLE_OHM[0][2:]) + 2e-3))


DEGC = (0.0, 20.0, 40.0)


@pytest.fixture(scope="module")
def fits() -> TableFits:
    fit = make_fit()
    fits = []
    for factor in (2.0, 1.0, 0.5):
        r0, *r = (tuple(factor * np.array(each)) for each in TABLE_OHM)
        tables = fit.tables.with_tables(dict(zip(fit.tables.resistances, (r0, *r), strict=True)))
        fits.append(replace(fit, tables=tables))
    return TableFits(tuple(fits), OverTemperature(DEGC, 1e-3, 1e-3, 1e-3, (), ()))


def test_between_temperatures_stands_what_is_interpolated(fits):
    figure = plot_over_temperature(fits)
    # A zero has no logarithm.
    assert ["log" in axes.get_ylabel() for axes in figure.axes] == [True, False, True]
    place = int(np.argmin(np.abs(np.array(NODES) - 0.5)))
    ends = 1e3 * TABLE_OHM[0][place] * np.array([2.0, 0.5])
    courses = [own for own in figure.axes[0].get_lines() if len(own.get_xdata()) > len(DEGC)]
    (course,) = (own for own in courses if own.get_ydata()[0] == pytest.approx(ends[0]))
    assert course.get_ydata()[-1] == pytest.approx(ends[-1])
    assert course.get_linestyle() == "--"
    # A quarter of the way in 1/T from 0 to 20 degC is a quarter of the way in log R.
    kelvin = 1 / (0.75 / 273.15 + 0.25 / 293.15)
    there = np.interp(kelvin - 273.15, course.get_xdata(), course.get_ydata())
    assert there == pytest.approx(ends[0] / 2**0.25, rel=1e-3)
    assert fits.at(18.0) == fits.fits[1].tables
