"""`Result.simulate`: a current of one's own, against closed forms and a loop of the equations."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

from barnax.errors import InputError
from helpers.results import (
    CAPACITY_AH,
    CORRECTION_V,
    NODES,
    PAIRS,
    TABLE_OHM,
    TABLE_TAU_S,
    make_result,
    make_table_result,
)

TIME_S = np.arange(200.0)
CURRENT_A = np.where(TIME_S % 40 < 20, 2.5, -1.0)
COLUMNS = {"Time [s]": TIME_S, "Current [A]": CURRENT_A}
OVERCHARGED = {"Time [s]": [0.0, 3600.0, 7200.0], "Current [A]": [-1.0] * 3}
SOC = 0.9 - np.append(0.0, np.cumsum(CURRENT_A[:-1])) / 3600 / CAPACITY_AH


def closed_form_v(result, soc=SOC):
    voltage_v = result.cell.average_ocv_v(soc) - 0.0511 * CURRENT_A
    for r, c in PAIRS[:2]:
        decay = math.exp(-1 / (r * c))
        voltage_v -= lfilter([0, r * (1 - decay)], [1, -decay], CURRENT_A)
    return voltage_v


def test_a_constant_circuit_is_simulated_as_its_closed_form():
    result = make_result("so-rc")
    actual = result.simulate(COLUMNS)
    assert list(actual) == ["Time [s]", "Current [A]", "Voltage [V]", "SOC"]
    np.testing.assert_allclose(actual["Voltage [V]"], closed_form_v(result), rtol=1e-12)
    np.testing.assert_allclose(actual["SOC"], SOC, rtol=1e-12)


def test_tables_are_simulated_as_their_equations_say():
    result = make_table_result("so-rc")
    expected_v, across_v = [], np.zeros(2)
    for soc, current_a in zip(SOC, CURRENT_A, strict=True):
        r0, *r = (np.interp(soc, NODES, each) for each in TABLE_OHM)
        ocv_v = result.cell.average_ocv_v(np.array(soc)) + np.interp(soc, NODES, CORRECTION_V)
        expected_v.append(ocv_v - r0 * current_a - across_v.sum())
        decay = np.exp(-1 / np.array(TABLE_TAU_S))
        across_v = decay * across_v + (1 - decay) * np.array(r) * current_a
    actual = result.simulate(CURRENT_A, TIME_S)
    np.testing.assert_allclose(actual["Voltage [V]"], expected_v, rtol=1e-12)


def test_a_given_start_is_where_it_starts():
    result = make_result("iso-rc")
    actual = result.simulate(COLUMNS, initial_soc=0.5, initial_direction=-1)
    soc = SOC - 0.4
    np.testing.assert_allclose(actual["SOC"], soc, rtol=1e-12)
    # Discharged before, and discharged at once: half the gap below the average throughout.
    first_v = closed_form_v(make_result("so-rc"), soc)[:20] - result.cell.hysteresis_v(soc)[:20] / 2
    np.testing.assert_allclose(actual["Voltage [V]"][:20], first_v, rtol=1e-12)


@pytest.mark.parametrize(
    ("given", "options", "told"),
    [
        ({"Current [A]": [1.0, 1.0]}, {}, r"no column of the time among Current \[A\]"),
        (CURRENT_A, {}, "has no times; give them in s"),
        ({**COLUMNS, "Time [s]": TIME_S // 2}, {}, r"'Time \[s\]' does not rise from row 0 \(from"),
        ({**COLUMNS, "Current [A]": CURRENT_A * np.nan}, {}, r"'Current \[A\]' is nan in row 0 \("),
        ({"Time [s]": [0.0], "Current [A]": [1.0]}, {}, "at least two times"),
        ({"Time [s]": [0.0, 1.0, 2.0], "Current [A]": [0.0, 2.0]}, {}, r"row 2 \(from 0\) is inc"),
        (COLUMNS, {"initial_soc": 60.0}, "`initial_soc` 60.0 is not a fraction"),
        (OVERCHARGED, {}, r"state of charge of 1\.400 at 3600 s \(sample 1\).*0\.000 to 1\.000"),
        (COLUMNS, {"temperature": 10.0}, "of no known temperature, and says nothing of 10 degC"),
    ],
)
def test_what_cannot_be_simulated_is_refused_in_words(given, options, told):
    with pytest.raises(InputError, match=told):
        make_result("so-rc").simulate(given, **options)


def test_every_record_is_simulated_from_the_start_that_it_had():
    result = make_result("so-rc", initial_soc=1.0000347)
    assert result.simulate(COLUMNS)["SOC"][0] == result.start.soc == 1.0000347
    (part,) = result.of_role("identification")
    second = part.model_copy(update={"start": replace(part.start, soc=1.002), "name": "b"})
    several = result.model_copy(update={"inputs": (*result.inputs, second)})
    assert several.simulate(COLUMNS, initial_soc=1.002)["SOC"][0] == 1.002


def test_a_start_beyond_the_ocv_is_simulated_with_a_warning():
    """An OCV of the records' own reaches as far as their scored samples do."""
    result = make_result("so-rc")
    names = "charge_points", "discharge_points"
    points = {n: tuple(p for p in getattr(result.cell, n) if p.soc < 0.8) for n in names}
    (part,) = result.of_role("identification")
    scored = part.model_copy(update={"soc_range": (0.2, 0.79)})
    update = {"cell": replace(result.cell, **points), "inputs": (scored, *result.inputs[1:])}
    with pytest.warns(UserWarning, match=r"identified on \(20 to 79 %\), and beyond its OCV"):
        actual = result.model_copy(update=update).simulate(COLUMNS)
    assert actual["SOC"][0] == 0.9


def test_a_column_of_temperature_that_changes_is_said_not_to_be_followed():
    profile = {**COLUMNS, "Temperature [degC]": np.linspace(10.0, 40.0, len(TIME_S))}
    with pytest.warns(UserWarning, match="one temperature, given with `temperature`"):
        make_result("so-rc").simulate(profile)
