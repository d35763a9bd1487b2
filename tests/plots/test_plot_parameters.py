"""Circuits side by side: every seed's own parameters, and what online methods saw."""

import io
from types import SimpleNamespace

import numpy as np
import pytest

from barnax.baselines import Answer, Trajectory
from barnax.cell import CircuitParameters
from barnax.plots import plot_compared_parameters, plot_trajectories
from barnax.plots.parameters import readable
from helpers.comparisons import BOX, PARAMETERS, make_comparison, make_row
from helpers.results import line, make_evaluation, make_record


def test_a_trajectory_is_its_median_in_each_percent_and_breaks_where_there_is_none():
    prepared = make_evaluation(make_record(2000)).prepared
    count = len(prepared.soc)
    percent = np.minimum(np.floor(100 * prepared.soc), 99)
    full = percent == percent.max()
    # One percent holds an outlier, the next nothing, all others what they are.
    r0 = np.full(count, 0.05)
    r0[np.flatnonzero(full)[:1]] = 7.0
    r0[percent == percent.max() - 1] = np.nan
    path = Trajectory(prepared.time_s, r0, np.full((count, 1), 0.02), np.full((count, 1), 30.0))
    answer = Answer(CircuitParameters.constant(0.04, (0.02,), (1500.0,)), 0.01, 0, trajectory=path)
    problem = SimpleNamespace(prepared=prepared, bounds=SimpleNamespace(pairs=1))
    figure = plot_trajectories({"rls 1rc": SimpleNamespace(median=answer, problem=problem)})
    drawn = line(figure.axes[0], "rls 1rc").get_ydata()
    known = drawn[int(percent.min()) : int(percent.max()) + 1]
    np.testing.assert_allclose(known, [*[50.0] * (len(known) - 2), np.nan, 50.0])
    np.testing.assert_allclose(figure.axes[0].get_lines()[1].get_ydata(), 40.0)
    assert [axes.get_ylabel() for axes in figure.axes if axes.get_visible()] == [
        "R0 [mOhm]", "R1 [mOhm]", "tau1 [s]",
    ]  # fmt: skip


def test_a_comparison_without_an_online_method_has_no_trajectories():
    with pytest.raises(ValueError, match="no trajectory to draw"):
        plot_trajectories({})


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
