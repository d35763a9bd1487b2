import pytest
from hypothesis import given
from hypothesis import strategies as st

from barnax.cell import CircuitParameters
from barnax.errors import InputError

positive = st.floats(1e-6, 1e6)
circuits = st.builds(CircuitParameters, positive, positive, positive, positive, positive)


@given(circuits)
def test_the_ordered_circuit_has_the_faster_pair_first(circuit):
    assert circuit.ordered().tau1_s <= circuit.ordered().tau2_s


@given(circuits)
def test_ordering_twice_changes_nothing_more(circuit):
    assert circuit.ordered().ordered() == circuit.ordered()


@given(circuits)
def test_ordering_keeps_each_resistance_with_its_capacitance(circuit):
    pairs = {(circuit.r1, circuit.c1), (circuit.r2, circuit.c2)}
    ordered = circuit.ordered()
    assert {(ordered.r1, ordered.c1), (ordered.r2, ordered.c2)} == pairs


@given(circuits)
def test_a_circuit_survives_its_dictionary(circuit):
    assert CircuitParameters.from_dict(circuit.to_dict()) == circuit


def test_the_dictionary_uses_pybamm_names():
    circuit = CircuitParameters(0.05, 0.02, 500.0, 0.03, 2000.0)
    assert circuit.to_dict() == {
        "R0 [Ohm]": 0.05,
        "R1 [Ohm]": 0.02,
        "C1 [F]": 500.0,
        "R2 [Ohm]": 0.03,
        "C2 [F]": 2000.0,
    }


@pytest.mark.parametrize("value", [0.0, -1.0, float("nan"), float("inf")])
def test_a_value_that_is_not_positive_and_finite_is_refused(value):
    with pytest.raises(ValueError, match="C1"):
        CircuitParameters(0.05, 0.02, value, 0.03, 2000.0)


def test_a_missing_parameter_is_named():
    with pytest.raises(InputError, match=r"R2 \[Ohm\]"):
        CircuitParameters.from_dict({"R0 [Ohm]": 1, "R1 [Ohm]": 1, "C1 [F]": 1, "C2 [F]": 1})


def test_a_parameter_that_is_no_number_is_refused():
    values = CircuitParameters(0.05, 0.02, 500.0, 0.03, 2000.0).to_dict() | {"C2 [F]": "much"}
    with pytest.raises(InputError, match="much"):
        CircuitParameters.from_dict(values)  # pyright: ignore[reportArgumentType]
