"""Elements and circuits of them, against the closed forms of diffusion."""

from dataclasses import replace

import numpy as np
import pytest

from barnax.cell import Circuit, CircuitParameters, Element, get_circuit, make_circuit
from barnax.cell.elements import DIFFUSION, RC, add_element
from barnax.errors import InputError

TERMS = (np.arange(1, 20_001) - 0.5) ** 2 * np.pi**2


def exact_step(time):
    """What is left of the way after a step, by the series; its start by the error function."""
    early = 1 - 2 * np.sqrt(time / np.pi)
    series = np.array([np.sum(2 / TERMS * np.exp(-each * TERMS)) for each in time])
    return np.where(time < 1e-4, early, series)


def test_diffusion_answers_a_step_as_the_series_does_at_every_time():
    time = np.geomspace(1e-10, 20, 400)
    shares, ratios = np.array(DIFFUSION.shares), np.array(DIFFUSION.ratios)
    actual = np.exp(-time[:, None] / ratios) @ shares
    assert np.max(np.abs(actual - exact_step(time))) < 4.5e-5
    assert sum(DIFFUSION.shares) == pytest.approx(1, abs=1e-12)


def test_the_impedance_of_diffusion_is_the_finite_warburgs():
    root = np.sqrt(1j * np.geomspace(1e-4, 1e5, 200))
    shares, ratios = np.array(DIFFUSION.shares), np.array(DIFFUSION.ratios)
    actual = np.sum(shares / (1 + root[:, None] ** 2 * ratios), axis=1)
    exact = np.tanh(root) / root
    assert np.max(np.abs(actual - exact)) < 1.5e-4


@pytest.mark.parametrize(
    ("shares", "ratios", "message"),
    [
        ((0.5,), (1.0, 0.1), "1 shares and 2 ratios"),
        ((), (), "0 shares"),
        ((1.5, -0.5), (1.0, 0.1), "must be positive"),
        ((0.5, 0.4), (1.0, 0.1), r"add up to 0\.9"),
        ((0.5, 0.5), (0.1, 1.0), "must fall"),
    ],
)
def test_what_is_no_mixture_is_refused_by_the_elements_name(shares, ratios, message):
    with pytest.raises(InputError, match=f"the element[s of]* odd.*{message}|odd.*{message}"):
        Element("odd", "O", "odd", shares, ratios)


def test_a_slow_pair_of_next_to_nothing_does_not_bound_the_time_constant(short_problem):
    wide = Element("wide", "W", "wide", (0.004, 0.496, 0.496, 0.004), (256.0, 4.0, 0.25, 0.004))
    assert wide.slowest_ratio == 4.0
    assert DIFFUSION.slowest_ratio == DIFFUSION.ratios[0]
    circuit = make_circuit("tests/wide", "rc", wide)
    bounds = replace(short_problem.bounds, elements=circuit.elements)
    low_s, high_s = short_problem.bounds.tau_limits_s
    assert bounds.limits_s(1) == (low_s / 4, high_s / 4)


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("so-rc+warburg", "'so-rc[+]warburg' is not known.*[+]diffusion"),
        ("2rc+diffusion", "'2rc[+]diffusion' is not known"),
        ("1rc+diffusion+diffusion", "every element but RC pairs once"),
        ("1rc+diffusion+rc", "its RC pairs come first"),
        ("4rc+diffusion", "has 5 elements; a search takes at most 4"),
    ],
)
def test_what_no_circuit_is_is_refused(name, message):
    with pytest.raises(InputError, match=message):
        get_circuit(name)


def test_a_circuit_of_the_user_is_returned_by_its_name():
    made = make_circuit("cell/test_elements", "rc", "diffusion", like="iso-rc")
    assert get_circuit("cell/test_elements") is made
    assert made.hysteresis is get_circuit("iso-rc").hysteresis
    assert make_circuit("cell/test_elements", "rc", "diffusion", like="iso-rc") == made
    with pytest.raises(InputError, match="'cell/test_elements' is another circuit"):
        make_circuit("cell/test_elements", "rc")
    with pytest.raises(InputError, match="choose another name, without a \\+"):
        make_circuit("so-rc+diffusion", "rc")
    assert get_circuit("so-rc+diffusion").elements == ("rc", "rc", "diffusion")
    with pytest.raises(InputError, match="no element is called 'warburg'"):
        make_circuit("cell/other", "rc", "warburg")
    with pytest.raises(InputError, match="RC pairs come first"):
        Circuit("odd", "odd", ())


def test_parameters_with_diffusion_are_read_as_they_are_written():
    given = CircuitParameters.of_tau(
        0.05, (0.03, 0.01, 0.02), (90.0, 8.0, 400.0), 50.0, (RC.name, RC.name, DIFFUSION.name)
    )
    assert given.to_dict()["tau_D [s]"] == pytest.approx(400.0)
    read = CircuitParameters.from_dict(given.to_dict())
    assert read.tau_s == pytest.approx(given.tau_s)
    assert read.elements == given.elements
    # Elements keep the order in which they were written, not that in which they became known.
    add_element(Element("late", "Q", "late", (1.0,), (1.0,)))
    for elements in (("rc", "late", "diffusion"), ("rc", "diffusion", "late")):
        written = CircuitParameters.of_tau(
            0.05, (0.03, 0.01, 0.02), (9.0, 8.0, 7.0), None, elements
        )
        assert CircuitParameters.from_dict(written.to_dict()).elements == elements
    # Diffusion stays last, however fast it is.
    assert given.ordered().tau_s == pytest.approx((8.0, 90.0, 400.0))


def test_a_ladder_has_the_resistance_and_the_slope_of_its_element():
    elements = (RC.name, DIFFUSION.name)
    circuit = CircuitParameters.of_tau(0.05, (0.02, 0.03), (8.0, 400.0), None, elements)
    ladder = circuit.laddered()
    assert ladder.elements == (RC.name,) * (1 + len(DIFFUSION.shares))
    assert sum(ladder.r) == pytest.approx(0.05, rel=1e-9)
    tables = CircuitParameters.over_soc(
        (0.0, 1.0), (8.0, 400.0), (0.05,) * 2, ((0.02,) * 2, (0.03, 0.06))
    )
    of_tables = CircuitParameters.over_soc(
        tables.nodes, tables.tau_s, tables.ohm[0], tables.ohm[1:], elements=elements
    ).laddered()
    assert of_tables.tau_s == pytest.approx(ladder.tau_s)
    assert of_tables.ohm[2:].sum(axis=0) == pytest.approx((0.03, 0.06), rel=1e-9)
    assert circuit.laddered().laddered() == ladder
