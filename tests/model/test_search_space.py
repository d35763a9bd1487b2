"""The box in physical units, and the coordinates in which it is searched."""

import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from barnax.bounds_file import read_bounds
from barnax.errors import InputError
from barnax.model.coordinates import Coordinates
from barnax.model.search_space import SCALES, Bounds
from barnax.model.simulate import RCParameters

DEFAULT = Bounds.default(capacity_ah=2.0, interval_s=1.0, duration_s=1000.0)
TAUS = ("tau1 [s]", "tau2 [s]")


def box(ranges=None, fixed=None, source="box.toml"):
    return DEFAULT.with_changes(ranges or {}, fixed or {}, source)


BOXES = {
    "default": DEFAULT,
    "capacitance of one pair": box({"C1 [F]": (20.0, 500.0)}),
    "capacitance of both": box({"C1 [F]": (20.0, 500.0), "C2 [F]": (100.0, 1e4)}),
    "own time constants": box({"tau1 [s]": (1.0, 20.0), "tau2 [s]": (30.0, 300.0)}),
    "fixed capacitance": box(fixed={"C1 [F]": 500.0}),
    "fixed time constant": box(fixed={"tau2 [s]": 90.0}),
    "fixed resistances": box(fixed={"R0 [Ohm]": 0.05, "R2 [Ohm]": 0.01}),
    "a rate": Bounds.default(2.0, 1.0, 1000.0, has_rate=True),
}
every_box = pytest.mark.parametrize("name", BOXES)
every_scale = pytest.mark.parametrize("scale", SCALES)


pytestmark = pytest.mark.usefixtures("double_precision")


# Bounds


def test_resistances_scale_with_the_capacity_and_time_constants_with_the_record():
    ranges = Bounds.default(33.0, interval_s=1.016, duration_s=10_800.0).ranges
    # 0.1 to 200 mohm at 2 Ah.
    for name in ("R0 [Ohm]", "R1 [Ohm]", "R2 [Ohm]"):
        assert ranges[name] == pytest.approx((1e-4 * 2 / 33, 0.2 * 2 / 33), rel=1e-9)
    assert [ranges[name] for name in TAUS] == [(0.508, 10_800.0)] * 2
    # A record of one interval still has a box.
    low, high = Bounds.default(2.0, interval_s=10.0, duration_s=0.0).ranges["tau1 [s]"]
    assert low < high


def test_a_change_replaces_the_default_and_leaves_the_earlier_bounds_as_they_were():
    before = dict(DEFAULT.ranges)
    changed = box(
        {"R0 [Ohm]": (0.01, 0.02), "C1 [F]": (20.0, 100.0)}, {"R2 [Ohm]": 0.05, "C2 [F]": 500.0}
    )
    assert changed.ranges["R0 [Ohm]"] == (0.01, 0.02)
    assert changed.fixed == {"R2 [Ohm]": 0.05, "C2 [F]": 500.0}
    assert set(changed.ranges) == {"R0 [Ohm]", "R1 [Ohm]", "C1 [F]"}
    assert [changed.second_name(pair) for pair in (0, 1)] == ["C1 [F]", "C2 [F]"]
    assert DEFAULT.ranges == before


@pytest.mark.parametrize(
    ("ranges", "fixed", "message"),
    [
        ({"R9 [Ohm]": (0.1, 0.2)}, {}, "'R9 [Ohm]' is not a parameter of this circuit; there are"),
        ({"R0 [Ohm]": (0.2, 0.1)}, {}, "'R0 [Ohm]' are [0.2, 0.1]; they must be positive and the"),
        ({"R0 [Ohm]": (0.0, 0.1)}, {}, "'R0 [Ohm]' are [0.0, 0.1]; they must be positive"),
        ({"C1 [F]": (1.0, math.inf)}, {}, "'C1 [F]' are [1.0, inf]"),
        ({"C1 [F]": (math.nan, 2.0)}, {}, "'C1 [F]' are [nan, 2.0]"),
        ({}, {"C3 [F]": 1.0}, "'C3 [F]' is not a parameter"),
        ({}, {"C1 [F]": -500.0}, "'C1 [F]' cannot be fixed at -500.0; give a positive value"),
        ({"C1 [F]": (1.0, 2.0)}, {"C1 [F]": 1.5}, "'C1 [F]' is both bounded and fixed"),
        (dict.fromkeys(("C1 [F]", "tau1 [s]"), (1, 2)), {}, "'tau1 [s]' or 'C1 [F]', not both"),
        # Time constants that the record cannot show.
        ({"C1 [F]": (0.01, 0.1)}, {}, "R C is outside 0.5 to 1000 s"),
        ({}, {"C2 [F]": 1e-3}, "R C is outside 0.5 to 1000 s"),
        ({}, {"R1 [Ohm]": 1e-3, "C1 [F]": 1.0}, "R C is outside 0.5 to 1000 s"),
    ],
)
def test_a_box_that_cannot_be_is_refused_with_its_source_name_and_value(ranges, fixed, message):
    with pytest.raises(InputError) as refusal:
        box(ranges, fixed)
    assert str(refusal.value).startswith("box.toml: ")
    assert message in str(refusal.value)


# Bounds that users write


def test_bounds_are_read_from_a_toml_table(tmp_path):
    path = tmp_path / "box.toml"
    path.write_text('[bounds]\n"R0 [Ohm]" = [0.001, 1]\n"tau1 [s]" = [1, 20]\n')
    assert read_bounds(path) == {"R0 [Ohm]": (0.001, 1.0), "tau1 [s]": (1.0, 20.0)}


NO_PAIR = "'R0 [Ohm]' must be two numbers, [lower, upper]"


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"[bounds", "is not a TOML file"),
        (b'"R0 [Ohm]" = [0.1, 0.2]\n', "must hold one table, [bounds], with lines like"),
        (b'[bounds]\n"R0 [Ohm]" = 0.1\n', NO_PAIR + "; it is 0.1"),
        (b'[bounds]\n"R0 [Ohm]" = ["1", 2]\n', NO_PAIR),
        (b'[bounds]\n"R0 [Ohm]" = [0, ' + b"9" * 401 + b"]\n", "a number that is too large"),
        (b'[bounds]\n"R0 [Ohm]" = [0, ' + b"9" * 5000 + b"]\n", "is not a TOML file"),
        (b"#" * 16_001, "is longer than 16,000 bytes, and not read; give `bounds` a TOML file"),
    ],
)
def test_a_bounds_file_that_says_something_else_is_refused_by_name(tmp_path, content, message):
    path = tmp_path / "box.toml"
    path.write_bytes(content)
    with pytest.raises(InputError) as refusal:
        read_bounds(path)
    assert str(refusal.value).startswith(f"{path}: ")
    assert message in str(refusal.value)


# Coordinates


def points_in(coordinates):
    """Points all over the box, its two ends among them."""
    lower, upper = np.asarray(coordinates.lower), np.asarray(coordinates.upper)
    shares = np.random.default_rng(4).random((60, len(lower)))
    shares = np.concatenate([shares, np.zeros((1, len(lower))), np.ones((1, len(lower)))])
    return jnp.asarray(lower + shares * (upper - lower))


def physical(rc):
    """Circuits under PyBaMM's names, with both time constants and capacitances."""
    (r1, r2), (tau1, tau2) = rc.r, rc.tau
    values = {"R0 [Ohm]": rc.r0, "R1 [Ohm]": r1, "R2 [Ohm]": r2}
    values |= {"tau1 [s]": tau1, "tau2 [s]": tau2, "C1 [F]": tau1 / r1, "C2 [F]": tau2 / r2}
    values |= {} if rc.gamma is None else {"gamma": rc.gamma}
    return {name: np.asarray(value) for name, value in values.items()}


def assert_same(found, expected, rtol=1e-11):
    for name, values in physical(expected).items():
        np.testing.assert_allclose(physical(found)[name], values, rtol=rtol)


@every_box
@every_scale
def test_every_point_of_the_box_is_a_circuit_inside_the_bounds(name, scale):
    coordinates = Coordinates.of(BOXES[name], scale)
    circuits = physical(jax.vmap(coordinates.decode)(points_in(coordinates)))
    for bound, (low, high) in BOXES[name].ranges.items():
        assert (low * (1 - 1e-12) <= circuits[bound]).all()
        assert (circuits[bound] <= high * (1 + 1e-12)).all()
    for bound, value in BOXES[name].fixed.items():
        np.testing.assert_allclose(circuits[bound], value, rtol=1e-14)


@every_box
@every_scale
def test_a_circuit_survives_encoding(name, scale):
    coordinates = Coordinates.of(BOXES[name], scale)
    points = points_in(coordinates)
    circuits = jax.vmap(coordinates.decode)(points)
    again = coordinates.encode(circuits)
    assert_same(jax.vmap(coordinates.decode)(again), circuits)
    # A point whose time constant is clipped stands for the same circuit as its clipped twin.
    if scale == "log" and "capacitance of" not in name:
        np.testing.assert_allclose(again, points, atol=1e-11)


def test_the_raw_box_of_capacitance_holds_every_allowed_time_constant():
    # C = tau / R is smallest at the shortest tau and largest R, and the other way round.
    coordinates = Coordinates.of(DEFAULT, "rc")
    assert coordinates.names == ("R0 [Ohm]", "R1 [Ohm]", "C1 [F]", "R2 [Ohm]", "C2 [F]")
    np.testing.assert_allclose(coordinates.lower[2], 0.5 / 0.2)
    np.testing.assert_allclose(coordinates.upper[2], 1000.0 / 1e-4)


@every_scale
def test_a_circuit_outside_the_box_is_encoded_at_its_nearest_end(scale):
    coordinates = Coordinates.of(DEFAULT, scale)
    outside = jax.tree.map(jnp.asarray, RCParameters(9.0, (9.0, 1e-9), (1e6, 1e-6)))
    circuit = physical(coordinates.decode(coordinates.encode(outside)))
    actual = [float(circuit[name]) for name in ("R0 [Ohm]", "R1 [Ohm]", "R2 [Ohm]")]
    assert actual == pytest.approx([0.2, 0.2, 1e-4])


def test_an_unknown_scale_is_refused_with_the_known_ones():
    with pytest.raises(InputError, match="`coordinates` 'decibel' is not known; there are rc, log"):
        Coordinates.of(DEFAULT, "decibel")


def test_a_box_with_nothing_free_is_refused():
    fixed = {"R0 [Ohm]": 0.05, "R1 [Ohm]": 0.01, "R2 [Ohm]": 0.01, "C1 [F]": 1e3, "tau2 [s]": 60.0}
    with pytest.raises(InputError, match="every parameter is fixed; leave at least one free"):
        Coordinates.of(box(fixed=fixed), "log")


@every_box
def test_every_circuit_of_the_box_is_between_its_resistance_bounds_and_time_constants(name):
    bounds = BOXES[name]
    coordinates = Coordinates.of(BOXES[name], "log")
    circuits = jax.vmap(coordinates.decode)(points_in(coordinates))
    tau_s = np.stack([np.asarray(tau) for tau in circuits.tau])
    low, high = bounds.resistance_box(tau_s)
    actual = np.stack([np.asarray(each) for each in (circuits.r0, *circuits.r)])
    # Where R C was clipped its C is no longer the box's.
    ends = np.array([bounds.tau_range_s(pair) for pair in (0, 1)])[:, :, None]
    assert ((ends[:, 0] * (1 - 1e-12) <= tau_s) & (tau_s <= ends[:, 1] * (1 + 1e-12))).all()
    limits = np.array(BOXES[name].tau_limits_s)[:, None, None]
    is_clipped = np.isclose(tau_s, limits, rtol=1e-12).any(axis=(0, 1))
    inside = (low * (1 - 1e-11) <= actual) & (actual <= high * (1 + 1e-11))
    assert inside[:, ~is_clipped].all()


def test_a_bounded_capacitance_bounds_the_resistance_at_a_time_constant():
    low, high = BOXES["capacitance of both"].resistance_box(np.array([5.0, 50.0]))
    np.testing.assert_allclose(low, [1e-4, 5 / 500, 50 / 1e4])
    np.testing.assert_allclose(high, [0.2, 0.2, 0.2])
    fixed = BOXES["fixed capacitance"].resistance_box(np.array([5.0, 50.0]))
    assert fixed[0][1] == fixed[1][1] == pytest.approx(5 / 500)
