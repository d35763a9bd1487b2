"""Circuits side by side: every seed's own parameters, and what online methods saw."""

import numpy as np

from barnax.plots import plot_compared_parameters
from helpers.comparisons import PARAMETERS, make_comparison, make_row
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
