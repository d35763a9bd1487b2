"""The landscape of two time constants, with everyone who walked in it."""

import io

import numpy as np
import pytest

from barnax.cell import CircuitParameters
from barnax.global_optimum import Landscape
from barnax.plots import plot_landscape

TAU_S = np.geomspace(1.0, 1000.0, 13)


def make_landscape():
    """A bowl whose lowest point is at 10 s and 100 s, without a value where tau1 > tau2."""
    first, second = np.log10(TAU_S)[:, None], np.log10(TAU_S)
    rmse_v = 0.02 * (1 + (first - 1) ** 2 + (second - 2) ** 2)
    return landscape_over(np.where(first <= second, rmse_v, np.nan))


def landscape_over(rmse_v, tau_s=(TAU_S, TAU_S), gamma=None):
    return Landscape(tau_s, gamma, rmse_v, np.zeros((3, *rmse_v.shape)))


def make_circuit(tau1_s, tau2_s):
    return CircuitParameters(r0=0.05, r=(0.01, 0.02), c=(tau1_s / 0.01, tau2_s / 0.02))


def line(axes, label):
    (found,) = [line for line in axes.get_lines() if line.get_label() == label]
    return found


def test_everyone_stands_at_their_time_constants_the_shorter_first():
    axes = plot_landscape(
        make_landscape(),
        answers={"ibmo so-rc": [make_circuit(9.0, 90.0), make_circuit(200.0, 20.0)]},
        refined=[make_circuit(10.0, 100.0)],
        optimum=make_circuit(10.0, 100.0),
        others=[make_circuit(1.0, 500.0)],
    ).axes[0]
    np.testing.assert_allclose(line(axes, "ibmo so-rc").get_xdata(), [9.0, 20.0])
    np.testing.assert_allclose(line(axes, "ibmo so-rc").get_ydata(), [90.0, 200.0])
    np.testing.assert_allclose(line(axes, "global optimum").get_xydata(), [[10.0, 100.0]])
    np.testing.assert_allclose(line(axes, "other local optima").get_xydata(), [[1.0, 500.0]])
    assert line(axes, "refined by Levenberg-Marquardt").get_zorder() > 2


def test_what_was_found_beyond_the_box_stands_at_its_edge_and_is_said_to():
    answers = {"ls so-rc": [make_circuit(0.2, 5000.0)], "ibmo so-rc": [make_circuit(9.0, 90.0)]}
    axes = plot_landscape(make_landscape(), answers=answers).axes[0]
    beyond = line(axes, "ls so-rc (outside the bounds)")
    np.testing.assert_allclose(beyond.get_xydata(), [[1.0, 1000.0]])
    np.testing.assert_allclose(line(axes, "ibmo so-rc").get_xydata(), [[9.0, 90.0]])


def test_the_steps_count_from_the_lowest_value_and_the_bar_names_it():
    figure = plot_landscape(make_landscape())
    figure.savefig(io.BytesIO())
    landscape, bar = figure.axes
    assert bar.get_ylabel() == "RMSE above the lowest, 20 mV [%]"
    assert landscape.get_xlim() == (1.0, 1000.0)
    assert landscape.get_legend() is None


def test_steps_of_color_are_told_apart_in_grey():
    colors = plot_landscape(make_landscape()).axes[0].collections[0].get_facecolor()
    lightness = colors[:, :3] @ [0.2126, 0.7152, 0.0722]
    assert np.all(np.diff(lightness) > 0.02)


def test_the_legend_stands_where_there_is_nothing_to_hide():
    optimum = make_circuit(10.0, 100.0)
    assert plot_landscape(make_landscape(), optimum=optimum).axes[0].get_legend() is not None
    figure = plot_landscape(landscape_over(0.02 + 0.01 * np.ones((13, 13))), optimum=optimum)
    assert figure.axes[0].get_legend() is None
    assert len(figure.legends) == 1


def test_pairs_with_boxes_of_their_own_keep_their_order():
    full = landscape_over(np.full((13, 13), 0.02))
    axes = plot_landscape(full, optimum=make_circuit(100.0, 10.0)).axes[0]
    np.testing.assert_allclose(line(axes, "global optimum").get_xydata(), [[100.0, 10.0]])
    assert axes.get_xlabel() == "Time constant tau1 [s]"


def test_of_the_rates_of_a_hysteresis_the_best_counts():
    known_v = make_landscape().rmse_v
    deep = landscape_over(np.stack([known_v, known_v / 2], axis=-1), gamma=np.array([1.0, 9.0]))
    assert "the lowest, 10 mV" in plot_landscape(deep).axes[1].get_ylabel()


def test_circuits_of_another_number_of_pairs_are_refused():
    with pytest.raises(ValueError, match="two RC pairs"):
        plot_landscape(make_landscape(), optimum=CircuitParameters(0.05, (0.01,), (1000.0,)))


@pytest.mark.parametrize(
    "tau_s", [(TAU_S,), (TAU_S, np.array([5.0])), (TAU_S, TAU_S, TAU_S)], ids=len
)
def test_what_has_not_two_time_constants_to_choose_is_refused(tau_s):
    shape = tuple(len(each) for each in tau_s)
    with pytest.raises(ValueError, match="two time constants"):
        plot_landscape(landscape_over(np.full(shape, 0.02), tau_s))
