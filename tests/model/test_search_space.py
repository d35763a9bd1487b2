import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from barnax.errors import InputError
from barnax.model.search_space import SCALES, Bounds, Coordinates
from barnax.model.simulate import RCParameters

DEFAULT = Bounds.default(2.0, 1.0, 1000.0)
BOXES = {
    "default": DEFAULT,
    "capacitance of one pair": DEFAULT.with_changes({"C1 [F]": (20.0, 500.0)}, {}, ""),
    "capacitance of both": DEFAULT.with_changes(
        {"C1 [F]": (20.0, 500.0), "C2 [F]": (100.0, 1e4)}, {}, ""
    ),
    "own time constants": DEFAULT.with_changes(
        {"tau1 [s]": (1.0, 20.0), "tau2 [s]": (30.0, 300.0)}, {}, ""
    ),
    "fixed capacitance": DEFAULT.with_changes({}, {"C1 [F]": 500.0}, ""),
    "fixed time constant": DEFAULT.with_changes({}, {"tau2 [s]": 90.0}, ""),
    "fixed resistances": DEFAULT.with_changes({}, {"R0 [Ohm]": 0.05, "R2 [Ohm]": 0.01}, ""),
}
every_box = pytest.mark.parametrize("box", BOXES)
every_scale = pytest.mark.parametrize("scale", SCALES)
few = settings(max_examples=20, deadline=None)
fractions = st.lists(st.floats(0, 1), min_size=5, max_size=5)


@pytest.fixture(autouse=True)
def _float64():
    with jax.enable_x64(True):
        yield


def place(coordinates, parts):
    lower, upper = np.asarray(coordinates.lower), np.asarray(coordinates.upper)
    return jnp.asarray(lower + np.array(parts[: len(lower)]) * (upper - lower))


def physical(rc):
    """The circuit under PyBaMM's names, with time constants."""
    (r1, r2), (tau1, tau2) = rc.r, rc.tau
    values = {"R0 [Ohm]": rc.r0, "R1 [Ohm]": r1, "R2 [Ohm]": r2}
    values |= {"tau1 [s]": tau1, "tau2 [s]": tau2, "C1 [F]": tau1 / r1, "C2 [F]": tau2 / r2}
    return {name: float(value) for name, value in values.items()}


@every_box
@every_scale
@few
@given(parts=fractions)
def test_every_point_of_the_box_is_a_circuit_inside_the_bounds(box, scale, parts):
    bounds = BOXES[box]
    coordinates = Coordinates.of(bounds, scale)
    circuit = physical(coordinates.decode(place(coordinates, parts)))
    for name, (low, high) in bounds.ranges.items():
        assert low * (1 - 1e-12) <= circuit[name] <= high * (1 + 1e-12)
    for name, value in bounds.fixed.items():
        assert circuit[name] == pytest.approx(value, rel=1e-14)


@every_box
@every_scale
@few
@given(parts=fractions)
def test_a_circuit_survives_encoding(box, scale, parts):
    coordinates = Coordinates.of(BOXES[box], scale)
    circuit = coordinates.decode(place(coordinates, parts))
    again = coordinates.decode(coordinates.encode(circuit))
    assert physical(again) == pytest.approx(physical(circuit), rel=1e-11)


@every_box
@few
@given(parts=fractions)
def test_a_point_in_log_coordinates_survives_decoding(box, parts):
    coordinates = Coordinates.of(BOXES[box], "log")
    point = place(coordinates, parts)
    decoded = coordinates.decode(point)
    again = coordinates.encode(decoded)
    if "capacitance" in box and "fixed" not in box:
        # A point whose time constant is clipped stands for the same circuit as its clipped twin.
        assert physical(coordinates.decode(again)) == pytest.approx(physical(decoded), rel=1e-11)
    else:
        np.testing.assert_allclose(again, point, atol=1e-11)


@few
@given(parts=fractions)
def test_a_raw_point_survives_decoding_unless_its_time_constant_is_clipped(parts):
    coordinates = Coordinates.of(DEFAULT, "rc")
    point = place(coordinates, parts)
    expected = np.array(point)
    for r, c in ((1, 2), (3, 4)):
        expected[c] = np.clip(point[r] * point[c], 1 / 2, 1000.0) / point[r]
    again = coordinates.encode(coordinates.decode(point))
    np.testing.assert_allclose(again, expected, rtol=1e-11)


def test_the_raw_box_of_capacitance_holds_every_allowed_time_constant():
    # C = tau / R is smallest at the shortest tau and largest R, and the other way round.
    coordinates = Coordinates.of(DEFAULT, "rc")
    assert coordinates.names == ("R0 [Ohm]", "R1 [Ohm]", "C1 [F]", "R2 [Ohm]", "C2 [F]")
    np.testing.assert_allclose(coordinates.lower[2], 0.5 / 0.2)
    np.testing.assert_allclose(coordinates.upper[2], 1000.0 / 1e-4)


@pytest.mark.parametrize(("resistance", "tau_s"), [(0.2, 1000.0), (1e-4, 0.5)])
def test_a_capacitance_beyond_the_time_constants_is_clipped(resistance, tau_s):
    # 0.2 ohm and 1e5 F would be 20,000 s, 0.1 mohm and 10 F a millisecond.
    capacitance = 1e5 if tau_s == 1000.0 else 10.0
    point = jnp.array([0.05, resistance, capacitance, 0.01, 1e4])
    circuit = physical(Coordinates.of(DEFAULT, "rc").decode(point))
    assert circuit["tau1 [s]"] == tau_s
    assert circuit["C1 [F]"] == pytest.approx(tau_s / resistance)
    assert circuit["C2 [F]"] == pytest.approx(1e4)


def test_the_log_coordinates_are_logarithms_of_resistances_and_time_constants():
    coordinates = Coordinates.of(DEFAULT, "log")
    assert coordinates.names == ("R0 [Ohm]", "R1 [Ohm]", "tau1 [s]", "R2 [Ohm]", "tau2 [s]")
    circuit = coordinates.decode(jnp.log(jnp.array([0.05, 0.01, 5.0, 0.02, 80.0])))
    expected = [0.05, 0.01, 0.02, 5.0, 80.0, 500.0, 4000.0]
    assert list(physical(circuit).values()) == pytest.approx(expected)


def test_a_bounded_capacitance_is_searched_as_such_in_both_scales():
    for scale in SCALES:
        coordinates = Coordinates.of(BOXES["capacitance of one pair"], scale)
        ends = np.array([coordinates.lower[2], coordinates.upper[2]])
        assert coordinates.names[2] == "C1 [F]"
        np.testing.assert_allclose(np.exp(ends) if scale == "log" else ends, [20.0, 500.0])


@every_scale
def test_a_fixed_parameter_is_no_coordinate(scale):
    coordinates = Coordinates.of(BOXES["fixed resistances"], scale)
    assert len(coordinates.lower) == 3
    assert not {"R0 [Ohm]", "R2 [Ohm]"} & set(coordinates.names)


@every_scale
def test_a_circuit_outside_the_box_is_encoded_at_its_nearest_end(scale):
    coordinates = Coordinates.of(DEFAULT, scale)
    outside = jax.tree.map(jnp.asarray, RCParameters(9.0, (9.0, 1e-9), (1e6, 1e-6)))
    circuit = physical(coordinates.decode(coordinates.encode(outside)))
    assert circuit["R0 [Ohm]"] == pytest.approx(0.2)
    assert circuit["R1 [Ohm]"] == pytest.approx(0.2)
    assert circuit["R2 [Ohm]"] == pytest.approx(1e-4)


def test_an_unknown_scale_is_refused_with_the_known_ones():
    with pytest.raises(InputError, match="'decibel' are not known; there are rc, log"):
        Coordinates.of(DEFAULT, "decibel")


def test_a_box_with_nothing_free_is_refused():
    fixed = {"R0 [Ohm]": 0.05, "R1 [Ohm]": 0.01, "R2 [Ohm]": 0.01, "C1 [F]": 1e3, "tau2 [s]": 60.0}
    with pytest.raises(InputError, match="every parameter is fixed; leave at least one free"):
        Coordinates.of(DEFAULT.with_changes({}, fixed, ""), "log")
