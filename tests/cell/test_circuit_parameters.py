import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from barnax.cell import CircuitParameters
from barnax.errors import InputError

positive = st.floats(1e-6, 1e6)


@st.composite
def circuits(draw) -> CircuitParameters:
    pairs = draw(st.integers(1, 4))
    r, c = (tuple(draw(positive) for _ in range(pairs)) for _ in "rc")
    return CircuitParameters.constant(draw(positive), r, c, draw(st.none() | positive))


@given(circuits())
def test_the_ordered_circuit_has_the_same_pairs_from_fast_to_slow(circuit):
    ordered = circuit.ordered()
    assert list(ordered.tau_s) == sorted(circuit.tau_s)
    assert {*zip(ordered.r, ordered.c, strict=True)} == {*zip(circuit.r, circuit.c, strict=True)}
    assert CircuitParameters.from_dict(ordered.to_dict()) == ordered.ordered()


@pytest.mark.parametrize("value", [0.0, -1.0, float("nan"), float("inf")])
def test_a_value_that_is_not_positive_and_finite_is_refused_by_name(value):
    with pytest.raises(ValueError, match=r"^R0 \[Ohm\] must be"):
        CircuitParameters.constant(value, (0.02, 0.03), (500.0, 2000.0))
    with pytest.raises(ValueError, match=r"^C1 \[F\] must be"):
        CircuitParameters.constant(0.05, (0.02, 0.03), (value, 2000.0))
    with pytest.raises(ValueError, match=r"^gamma must be"):
        CircuitParameters.constant(0.05, (0.02, 0.03), (500.0, 2000.0), value)


@pytest.mark.parametrize("size", [1e-200, 1e200])
def test_a_time_constant_beyond_all_floats_is_refused_by_its_pair(size):
    with pytest.raises(ValueError, match=r"tau2 \[s\] must be positive and finite"):
        CircuitParameters.constant(0.05, (0.02, size), (500.0, size))


def test_resistances_without_capacitances_are_refused():
    with pytest.raises(ValueError, match="2 R and 1 C"):
        CircuitParameters.constant(0.05, (0.02, 0.03), (500.0,))


@pytest.mark.parametrize("name", ["R5 [Ohm]", "R9 [Ohm]", "x"])
def test_an_unknown_parameter_is_named(name):
    values = CircuitParameters.constant(0.05, (0.02,), (500.0,)).to_dict() | {name: 1.0}
    with pytest.raises(InputError, match=re.escape(f"not circuit parameters: {name}")):
        CircuitParameters.from_dict(values)
