"""The figures of tables over SOC and temperature: nodes, bands, what is between, errors by cell."""

from dataclasses import replace

import numpy as np
import pytest

from barnax.cell import CircuitParameters
from barnax.cell.parameters import OCV
from barnax.over_soc import OverTemperature, TableFits
from barnax.over_soc.intervals import NodeInterval
from barnax.plots import (
    plot_over_temperature,
    plot_summary,
    plot_tables,
)
from barnax.plots.soc_tables import drawn_tables, scale_of
from helpers.results import CIRCUIT, NODES, TABLE_OHM, line, make_evaluation, make_fit, make_record

SOCS = (0.1, 0.5, 0.9)


def test_there_is_a_panel_for_every_table_with_its_unit():
    figure = plot_tables(make_fit())
    labels = [axes.get_ylabel() for axes in figure.axes]
    assert labels == ["R0 [mOhm]", "R1 [mOhm]", "R2 [mOhm]", "OCV correction [mV]"]
    assert figure.axes[1].get_title(loc="left") == "tau1 = 9 s"


def test_an_ocv_of_the_records_own_has_a_panel_too():
    fit = make_fit()
    own = [NodeInterval(OCV, soc, 3.0 + soc, 0.01, 0.0, 2.9 + soc, 3.1 + soc) for soc in SOCS]
    axes = plot_tables(replace(fit, intervals=(*fit.intervals, *own))).axes[-1]
    assert axes.get_ylabel() == "OCV [V]"
    np.testing.assert_allclose(line(axes, "node").get_ydata(), [3.0 + soc for soc in SOCS])
    low, high = axes.get_ylim()
    assert 2.7 < low < 2.9 + SOCS[0]
    assert 3.1 + SOCS[-1] < high < 4.3


def test_all_constants_are_in_the_scale_of_the_summary():
    circuit = CircuitParameters.constant(r0=2e-3, r=(1e-3, 0.9), c=(1e3, 1e6))
    evaluation = make_evaluation(make_record(600))
    fit = replace(make_fit(), tables=circuit, intervals=())
    axes = plot_summary(evaluation, fit).axes[-1]
    assert axes.get_ylim()[1] > 900
    assert not axes.get_title(loc="left")
    labels = [text.get_text() for text in axes.get_legend().get_texts()]
    assert labels == ["R0", "R1, tau 1 s", "R2, tau longer than the record"]


def test_visited_nodes_are_filled_and_the_others_hollow():
    axes = plot_tables(make_fit()).axes[0]
    visited, others = line(axes, "node"), line(axes, "node without samples")
    np.testing.assert_allclose(visited.get_xdata(), NODES[2:])
    np.testing.assert_allclose(visited.get_ydata(), 1e3 * np.array(TABLE_OHM[0][2:]))
    np.testing.assert_allclose(others.get_xdata(), NODES[:2])
    assert others.get_markerfacecolor() == "white"
    assert visited.get_markerfacecolor() != "white"


def test_the_band_is_the_interval_of_visited_nodes_only():
    axes = plot_tables(make_fit()).axes[0]
    (band,) = [each for each in axes.collections if each.get_label() == "95 % interval"]
    points = band.get_paths()[0].vertices
    assert points[:, 0].min() == pytest.approx(NODES[2])
    assert points[:, 1].max() == pytest.approx(1e3 * (max(TABLE_OHM[0][2:]) + 2e-3))


def test_the_constant_circuit_stands_behind():
    axes = plot_tables(make_fit(), CIRCUIT).axes
    heights = [line(each, "constant circuit").get_ydata()[0] for each in axes[:3]]
    assert heights == pytest.approx([50.0, 10.0, 20.0])


def test_resistances_are_drawn_from_zero_and_what_is_beyond_is_said():
    fit = make_fit()
    steep = fit.tables.with_tables({"R0 [Ohm]": (0.9, 0.5, *TABLE_OHM[0][2:])})
    axes = plot_tables(replace(fit, tables=steep)).axes[0]
    assert axes.get_ylim()[0] == 0.0
    assert axes.get_ylim()[1] < 80
    assert axes.get_title(loc="right") == "off scale: 2 extrapolated nodes"


def test_a_node_that_is_not_determined_sets_no_scale_and_is_said_to_be_off_it():
    fit = make_fit()
    steep = fit.tables.with_tables({"R0 [Ohm]": (*TABLE_OHM[0][:2], 0.3, *TABLE_OHM[0][3:])})
    intervals = [
        replace(own, high=2.0) if (own.name, own.soc) == ("R0 [Ohm]", NODES[2]) else own
        for own in fit.intervals
    ]
    far = replace(fit, tables=steep, intervals=tuple(intervals))
    axes = plot_tables(far).axes[0]
    assert 1e3 * max(TABLE_OHM[0][3:]) < axes.get_ylim()[1] < 100
    assert "1 node at 300 mOhm" in axes.get_title(loc="right").replace("\n", " ")
    summary = plot_summary(make_evaluation(make_record(400)), far).axes[2]
    assert summary.get_ylim()[1] < 150
    # No marker is cut in half.
    low, high = summary.get_xlim()
    assert all(low < min(own.get_xdata()) <= max(own.get_xdata()) < high for own in summary.lines)
    assert summary.get_title(loc="left") == "off scale: 1 node at 300 mOhm"
    # Determined, it is shown.
    known = [
        replace(own, low=0.25, high=0.35) if (own.name, own.soc) == ("R0 [Ohm]", NODES[2]) else own
        for own in fit.intervals
    ]
    table = drawn_tables(replace(far, intervals=tuple(known)))["R0 [Ohm]"]
    assert scale_of([table])[1] > 300


DEGC = (0.0, 20.0, 40.0)


@pytest.fixture(scope="module")
def found() -> TableFits:
    fit = make_fit()
    fits = []
    for factor in (2.0, 1.0, 0.5):
        r0, *r = (tuple(factor * np.array(each)) for each in TABLE_OHM)
        tables = fit.tables.with_tables(dict(zip(fit.tables.resistances, (r0, *r), strict=True)))
        fits.append(replace(fit, tables=tables))
    return TableFits(tuple(fits), OverTemperature(DEGC, 1e-3, 1e-3, 1e-3, (), ()))


def test_between_temperatures_stands_what_is_interpolated(found):
    figure = plot_over_temperature(found)
    assert [axes.get_ylabel() for axes in figure.axes] == [
        "R0 [mOhm]\n(log scale)",
        # A zero has no logarithm.
        "R1 [mOhm]",
        "R2 [mOhm]\n(log scale)",
    ]
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
    assert found.at(18.0) == found.fits[1].tables
