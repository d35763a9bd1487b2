"""The figures of a comparison draw every row's own numbers, on one record and over its seeds."""

import io
from types import SimpleNamespace

import numpy as np
import pytest

from barnax.baselines import Answer, Trajectory
from barnax.cell import CircuitParameters
from barnax.comparison.result import SeedAnswerPart
from barnax.plots import (
    plot_compared_convergence,
    plot_compared_errors,
    plot_compared_parameters,
    plot_compared_voltages,
    plot_condition,
    plot_trajectories,
)
from barnax.plots.parameters import readable
from barnax.plots.style import row_looks
from helpers.results import line, make_evaluation, make_record
from sample_comparisons import BOX, PARAMETERS, make_comparison, make_failure, make_row


def make_rows(*sizes_v, samples=600, scored=None):
    record = make_record(samples)
    wave = np.sin(np.arange(samples) / 50)
    return {
        f"row {place}": make_evaluation(record, scored, size_v * wave)
        for place, size_v in enumerate(sizes_v)
    }


def labels(axes):
    return axes.get_legend_handles_labels()[1]


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
    answer = Answer(CircuitParameters(0.04, (0.02,), (1500.0,)), 0.01, 0, trajectory=path)
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


def test_the_condition_is_current_voltage_and_state_of_charge_over_time():
    scored = np.arange(600) >= 100
    prepared = make_evaluation(make_record(600), scored).prepared
    figure = plot_condition(prepared)
    drawn = [axes.get_lines()[0] for axes in figure.axes]
    for each, values in zip(
        drawn, (prepared.current_a, prepared.voltage_v, prepared.soc), strict=True
    ):
        np.testing.assert_array_equal(each.get_xdata(), prepared.time_s)
        np.testing.assert_array_equal(each.get_ydata(), values)
    assert labels(figure.axes[0]) == ["not scored"]


def test_a_condition_that_counts_throughout_needs_no_legend():
    assert plot_condition(make_evaluation(make_record(600)).prepared).legends == []


def test_every_row_s_voltage_is_drawn_over_the_measured_one():
    rows = make_rows(2e-3, 5e-3)
    whole = plot_compared_voltages(rows).axes[0]
    first = rows["row 0"]
    np.testing.assert_array_equal(line(whole, "measured").get_ydata(), first.prepared.voltage_v)
    for label, each in rows.items():
        name = f"{label} ({1e3 * each.metrics.rmse_v:.3g} mV)"
        np.testing.assert_array_equal(line(whole, name).get_ydata(), each.simulated_v)


def test_the_magnified_stretch_shows_the_same_rows_where_the_frame_is():
    whole, close = plot_compared_voltages(make_rows(2e-3, 5e-3, samples=2000)).axes
    assert labels(close) == labels(whole)
    origin = float(close.get_xlabel().split()[2])
    shown = line(close, "measured")
    time_s = shown.get_xdata() + origin
    measured = line(whole, "measured")
    at = np.searchsorted(measured.get_xdata(), time_s)
    np.testing.assert_array_equal(measured.get_ydata()[at], shown.get_ydata())


def test_a_short_record_has_no_stretch_to_magnify():
    figure = plot_compared_voltages(make_rows(2e-3, samples=60))
    figure.savefig(io.BytesIO())
    assert len(figure.axes) == 1


def test_of_many_rows_the_most_accurate_are_drawn_and_it_is_said():
    rows = make_rows(*np.arange(12, 0, -1) * 1e-3)
    whole = plot_compared_voltages(rows).axes[0]
    assert len(labels(whole)) == 1 + 8
    assert not any(label.startswith("row 3 ") for label in labels(whole))
    assert "the 8 of 12 rows with the lowest RMSE" in whole.get_title("left")


@pytest.mark.parametrize("plot", [plot_compared_voltages, plot_compared_errors])
def test_rows_on_different_samples_are_refused(plot):
    rows = make_rows(1e-3) | {"other": make_evaluation(make_record(500))}
    with pytest.raises(ValueError, match="different samples"):
        plot(rows)
    with pytest.raises(ValueError, match="no row"):
        plot({})


def test_every_row_s_errors_have_a_strip_on_one_scale():
    rows = make_rows(2e-3, 5e-3)
    axes = plot_compared_errors(rows).axes
    assert len(axes) == 4
    for (over_time, over_soc), each in zip(np.reshape(axes, (-1, 2)), rows.values(), strict=True):
        np.testing.assert_array_equal(over_time.get_lines()[0].get_ydata(), 1e3 * each.error_v)
        np.testing.assert_array_equal(over_soc.get_lines()[0].get_xdata(), each.prepared.soc)
        np.testing.assert_allclose(
            line(over_time, "± RMSE").get_ydata()[0], 1e3 * each.metrics.rmse_v
        )
    assert len({panel.get_ylim() for panel in axes}) == 1


def test_a_row_that_is_far_off_does_not_set_the_scale_and_is_said_to_be_cut():
    axes = plot_compared_errors(make_rows(2e-3, 500e-3)).axes
    assert axes[0].get_ylim()[1] < 20
    assert "outside:" in axes[3].texts[0].get_text()
    assert not axes[1].texts


def test_the_same_row_looks_the_same_in_every_figure():
    names = [f"row {place}" for place in range(40)]
    looks = row_looks(names)
    assert len({(look.color, look.line, look.marker) for look in looks.values()}) == 40
    rows = make_rows(2e-3, 5e-3)
    voltages, errors = plot_compared_voltages(rows).axes[0], plot_compared_errors(rows).axes
    for place, label in enumerate(rows):
        color = row_looks(rows)[label].color
        assert voltages.get_lines()[1 + place].get_color() == color
        assert errors[2 * place].get_lines()[0].get_color() == color


@pytest.mark.parametrize("plot", [plot_compared_convergence, plot_compared_parameters])
def test_a_row_without_an_answer_does_not_change_the_looks_of_the_others(plot):
    rows = [make_failure("rls so-rc", "No."), make_row("lm so-rc", 20.0)]
    colors = [
        {line.get_color() for line in plot(make_comparison(given)).axes[0].get_lines()}
        for given in (rows, rows[1:])
    ]
    assert colors[0] == colors[1]


def test_convergence_is_each_row_s_median_with_a_band_of_its_seeds():
    row = make_row("ibmo so-rc", 20.0)
    axes = plot_compared_convergence(make_comparison([row])).axes[0]
    median = line(axes, "ibmo so-rc")
    np.testing.assert_allclose(median.get_xdata(), [30, 165, 300])
    np.testing.assert_allclose(median.get_ydata(), [40.0, 30.0, 20.2])
    (band,) = axes.collections
    heights = band.get_paths()[0].vertices[:, 1]
    np.testing.assert_allclose([heights.min(), heights.max()], [20.04, 40.0])


def test_a_row_without_a_history_is_a_mark_at_what_it_spent():
    seed = SeedAnswerPart(rmse_v=0.03, parameters=PARAMETERS, evaluations=0, history_v=None)
    row = make_row("ls so-rc", 30.0, seeds=1).model_copy(update={"seeds": (seed,)})
    drawn = line(plot_compared_convergence(make_comparison([row])).axes[0], "ls so-rc")
    assert (drawn.get_xdata(), drawn.get_ydata()) == ([1.0], [30.0])


def test_the_excess_over_a_known_optimum_has_a_panel():
    rows = [make_row("ibmo so-rc", 20.0), make_row("ibmo esc", 20.0)]
    figure = plot_compared_convergence(make_comparison(rows, optima_mv={"so-rc": 20.0}))
    figure.savefig(io.BytesIO())
    assert labels(figure.axes[1]) == ["ibmo so-rc"]
    np.testing.assert_allclose(
        line(figure.axes[1], "ibmo so-rc").get_ydata(), [100.0, 50.0, 1.0], rtol=1e-6
    )
    assert len(plot_compared_convergence(make_comparison(rows)).axes) == 1


def test_generations_without_a_finite_error_are_not_drawn():
    seed = SeedAnswerPart(
        rmse_v=0.03, parameters=PARAMETERS, evaluations=20, history_v=(0.04, 0.03)
    )
    lost = seed.model_construct(**dict(seed) | {"history_v": (np.inf, 0.03)})
    row = make_row("bmo so-rc", 30.0).model_copy(update={"seeds": (lost,)})
    figure = plot_compared_convergence(make_comparison([]).model_copy(update={"rows": (row,)}))
    figure.savefig(io.BytesIO())
    np.testing.assert_array_equal(line(figure.axes[0], "bmo so-rc").get_ydata(), [np.nan, 30.0])


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


@pytest.mark.parametrize("plot", [plot_compared_convergence, plot_compared_parameters])
def test_a_stored_comparison_is_drawn_from_its_file(plot, tmp_path):
    result = make_comparison([make_row("lm so-rc", 20.0), make_failure("ls so-rc", "No.")])
    path = tmp_path / "comparison.json"
    path.write_text(result.to_json())
    drawn = [
        [each.get_xydata().tolist() for axes in plot(source).axes for each in axes.get_lines()]
        for source in (result, path, str(path))
    ]
    assert drawn[0] == drawn[1] == drawn[2]


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
