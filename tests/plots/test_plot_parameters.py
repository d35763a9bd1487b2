"""Circuits side by side: every seed's own parameters, and what online methods saw."""

import io

import numpy as np

from barnax.plots import plot_compared_parameters
from barnax.plots.search import readable
from helpers.comparisons import BOX, PARAMETERS, make_comparison, make_row
from helpers.results import line


def test_every_seed_s_parameters_are_drawn_beside_the_median_and_the_refined():
    rows = [make_row("ibmo so-rc", 20.0, refined_parameters=PARAMETERS | {"R0 [Ohm]": 0.07})]
    figure = plot_compared_parameters(make_comparison(rows))
    panels = {axes.get_xlabel(): axes for axes in figure.axes if axes.get_visible()}
    assert list(panels) == [
        "RMSE [mV]",
        "R0 [mOhm]",
        "R1 [mOhm]",
        "R2 [mOhm]",
        "tau1 [s]",
        "tau2 [s]",
    ]
    np.testing.assert_allclose(line(panels["RMSE [mV]"], "one seed").get_xdata(), [20, 20.2, 20.4])
    np.testing.assert_allclose(line(panels["R0 [mOhm]"], "one seed").get_xdata(), [50, 50, 50])
    np.testing.assert_allclose(line(panels["R0 [mOhm]"], "median seed").get_xdata(), [50, 50])
    np.testing.assert_allclose(line(panels["R0 [mOhm]"], "median seed, refined").get_xdata(), [70])


def test_equal_seeds_do_not_hide_each_other():
    axes = plot_compared_parameters(make_comparison([make_row("lm so-rc", 20.0)])).axes[1]
    assert len(set(line(axes, "one seed").get_ydata())) == 3
    assert np.all(np.abs(line(axes, "one seed").get_ydata()) < 0.5)


def test_a_parameter_that_a_model_has_not_got_is_left_out_of_its_line():
    figure = plot_compared_parameters(
        make_comparison([make_row("lm so-rc", 2.0), make_row("lm esc", 1.0)])
    )
    figure.savefig(io.BytesIO())
    (rate,) = [axes for axes in figure.axes if axes.get_xlabel() == "gamma [1/SOC]"]
    seeds = [each for each in rate.get_lines() if each.get_label() in ("one seed", "_seed")]
    assert np.isnan(seeds[0].get_xdata()).all()
    np.testing.assert_array_equal(seeds[1].get_xdata(), [300.0] * 3)


def test_bounds_in_view_are_drawn():
    near = BOX | {"R0 [Ohm]": (0.045, 0.2)}
    result = make_comparison([make_row("lm so-rc", 20.0)])
    model = result.models["so-rc"].model_copy(update={"bounds": near})
    axes = plot_compared_parameters(result.model_copy(update={"models": {"so-rc": model}})).axes[1]
    dotted = [each.get_xdata()[0] for each in axes.get_lines() if each.get_linestyle() == ":"]
    np.testing.assert_allclose(dotted, [45.0])


def test_readable_values_are_those_of_the_circuit():
    assert readable(PARAMETERS) == {
        "R0 [mOhm]": 50.0,
        "R1 [mOhm]": 10.0,
        "C1 [F]": 1000.0,
        "tau1 [s]": 10.0,
        "R2 [mOhm]": 20.0,
        "C2 [F]": 5000.0,
        "tau2 [s]": 100.0,
    }
