"""Tables between measured temperatures."""

import numpy as np
import pytest

from barnax.cell import CircuitParameters, TemperatureTables

NODES = (0.2, 0.8)


def arrhenius(temperature_degc, r0_ohm=0.05, activation_k=3000.0):
    """A resistance that falls as exp(activation / T), 50 mohm at 25 degC."""
    return r0_ohm * np.exp(activation_k * (1 / (273.15 + temperature_degc) - 1 / 298.15))


def tables_at(temperature_degc):
    r_ohm = float(arrhenius(temperature_degc))
    return CircuitParameters.over_soc(
        nodes=NODES,
        tau_s=(50.0,),
        r0_ohm=(r_ohm, 2 * r_ohm),
        r_ohm=((r_ohm / 4, r_ohm / 8),),
        ocv_correction_v=(1e-3 * temperature_degc, -1e-3 * temperature_degc),
        visited=(True, temperature_degc > 10),
    )


MEASURED = TemperatureTables((0.0, 25.0, 45.0), tuple(map(tables_at, (0.0, 25.0, 45.0))))


def test_arrhenius_resistances_and_linear_corrections_are_met_between_temperatures():
    actual, true = MEASURED.at(12.0), tables_at(12.0)
    assert actual.tables.keys() == true.tables.keys()
    for name, row in true.tables.items():
        assert actual.tables[name] == pytest.approx(row, rel=1e-12)
    assert actual.constants == true.constants


def test_a_measured_temperature_and_all_beyond_the_ends_have_its_tables_as_they_are():
    assert MEASURED.at(25.0) is MEASURED.tables[1]
    assert MEASURED.at(-30.0) is MEASURED.tables[0]
    assert MEASURED.at(90.0) is MEASURED.tables[2]


def test_a_node_counts_as_visited_only_where_both_neighbors_visited_it():
    assert MEASURED.at(12.0).visited == (True, False)
    assert MEASURED.at(30.0).visited == (True, True)


def test_a_resistance_at_zero_is_interpolated_without_a_logarithm():
    cold = tables_at(0.0).with_tables({"R0 [Ohm]": (0.0, 0.04)})
    actual = TemperatureTables((0.0, 40.0), (cold, tables_at(40.0))).at(20.0)
    share = (1 / 273.15 - 1 / 293.15) / (1 / 273.15 - 1 / 313.15)
    assert actual.r0 == pytest.approx(share * tables_at(40.0).r0, rel=1e-12)
