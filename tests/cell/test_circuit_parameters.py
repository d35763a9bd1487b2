import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from barnax import CircuitParameters, InputError

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


GIVEN = {"r0": 0.05, "r": (0.02, 0.03), "c": (500.0, 2000.0)}


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        *(
            ({"r0": value}, r"^R0 \[Ohm\] must be")
            for value in (0.0, -1.0, float("nan"), float("inf"))
        ),
        ({"c": (-1.0, 2000.0)}, r"^C1 \[F\] must be"),
        ({"gamma": 0.0}, "^gamma must be"),
        # Products beyond all floats.
        *(
            ({"r": (0.02, size), "c": (500.0, size)}, r"tau2 \[s\] must be positive and finite")
            for size in (1e-200, 1e200)
        ),
        ({"c": (500.0,)}, "2 R and 1 C"),
    ],
)
def test_values_that_are_no_circuit_are_refused_by_name(changed, message):
    with pytest.raises(ValueError, match=message):
        CircuitParameters.constant(**GIVEN | changed)


@pytest.mark.parametrize("name", ["R5 [Ohm]", "x"])
def test_an_unknown_parameter_is_named(name):
    values = CircuitParameters.constant(**GIVEN).to_dict() | {name: 1.0}
    with pytest.raises(InputError, match=re.escape(f"not circuit parameters: {name}")):
        CircuitParameters.from_dict(values)
