"""What every export starts from: curves over SOC as tables that are read linearly."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.interpolate import PchipInterpolator

import barnax.export.tables
from barnax.cell import SegmentedHysteresis
from barnax.cell.circuits import Circuit, Hysteresis
from barnax.errors import InputError
from barnax.export import EXPORTERS, HeldLoad
from barnax.export.tables import TOLERANCE_V, linear_table, segment_table, tables_of
from barnax.export.verification import pulse_profile, simulate_here
from barnax.fit.node_interval import NodeInterval
from barnax.search.answers import AtBound
from helpers.results import (
    CAPACITY_AH,
    CORRECTION_V,
    GAMMA,
    NODES,
    PAIRS,
    PAIRS_OF,
    TABLE_OHM,
    TABLE_TAU_S,
    WITH_GAMMA,
    make_cell,
    make_result,
    make_table_result,
    with_constant,
    with_fit,
)

from .conftest import DEGC, every_circuit, r0_ohm, run_module

FINE = np.linspace(0.0, 1.0, 40001)


@given(st.lists(st.floats(2.5, 4.3), min_size=3, max_size=12), st.integers(0, 2**32 - 1))
def test_a_table_follows_any_monotone_cubic_within_the_tolerance(voltages_v, seed):
    inner = np.random.default_rng(seed).uniform(0.01, 0.99, len(voltages_v) - 2)
    soc = np.sort(np.concatenate([[0.0, 1.0], inner]))
    soc = np.maximum.accumulate(soc + 1e-3 * np.arange(len(soc))) / (1 + 1e-3 * len(soc))
    curve = PchipInterpolator(soc, voltages_v, extrapolate=True)

    def clipped(at):
        return curve(np.clip(at, soc[0], soc[-1]))

    table = linear_table(clipped, soc)
    assert np.all(np.diff(table.soc) > 0)
    assert (table.soc[0], table.soc[-1]) == (0.0, 1.0)
    # Between the three places that are checked, a cubic bends little more.
    assert np.abs(table(FINE) - clipped(FINE)).max() < 1.1 * TOLERANCE_V


@pytest.mark.parametrize("fit", ["continuous", "independent"])
def test_the_hysteresis_table_reads_as_its_segments(fit):
    rng = np.random.default_rng(1)
    w = SegmentedHysteresis.fit(np.linspace(0, 1, 40), 0.02 * rng.random(40), fit)
    table = segment_table(w)
    assert np.all(np.diff(table.soc) > 0)
    # A step takes a billionth of SOC.
    np.testing.assert_allclose(table(FINE), w(FINE), rtol=0, atol=1e-9)


def test_a_time_constant_at_a_bound_is_a_caveat():
    told = "tau2 ended at the upper bound of its search: the data do not set it."
    (bound,) = bounds = (AtBound("tau2 [s]", "upper"),)
    result = make_table_result()
    over_soc = with_fit(result, at_bound=(bound,))
    for bounded in (over_soc, with_constant(make_result(), at_bound=bounds)):
        assert told in tables_of(bounded).caveats
    # The constant circuit beside tables is not what is exported.
    assert told not in tables_of(with_constant(result, at_bound=bounds)).caveats


@pytest.mark.parametrize("direction", [1, -1])
def test_the_hysteresis_starts_where_the_last_current_left_it(direction):
    tables = tables_of(make_result(initial_direction=direction))
    w_v = make_cell().hysteresis(np.array(0.9))
    assert tables.initial_hysteresis_v == pytest.approx(direction * w_v / 2, abs=1e-12)


@pytest.mark.parametrize(
    ("source", "ocv_v", "w_v"),
    [
        ({"ocv_v": lambda cell, soc: cell.discharge(soc)}, make_cell().discharge(FINE), None),
        (
            {
                "ocv_v": lambda cell, soc: 3.5 + 0 * soc,
                "hysteresis": Hysteresis("instant", lambda _, soc: 0.02 * soc**2),
            },
            3.5,
            0.02 * FINE**2,
        ),
    ],
    ids=["without hysteresis", "with one"],
)
def test_a_circuit_of_the_user_is_exported_with_its_source(monkeypatch, source, ocv_v, w_v):
    circuit = Circuit("with a source", "", **source)
    monkeypatch.setattr(barnax.export.tables, "get_circuit", lambda name: circuit)
    tables = tables_of(make_result())
    assert np.abs(tables.ocv(FINE) - ocv_v).max() < 1.1 * TOLERANCE_V
    assert tables.kind == ("none" if w_v is None else "instant")
    if w_v is None:
        assert tables.hysteresis is None
    else:
        assert np.abs(tables.hysteresis(FINE) - w_v).max() < 1.1 * TOLERANCE_V


def test_a_circuit_that_remembers_its_turns_is_refused():
    with pytest.raises(InputError, match="which no table over SOC holds"):
        tables_of(make_result("so-rc").model_copy(update={"model": "takacs"}))


def test_a_linear_look_up_follows_what_lies_between_temperatures(over_temperature):
    tables = tables_of(over_temperature)
    assert set(DEGC) <= set(tables.degc)
    rows = [np.interp(0.5, NODES, row) for row in tables.resistances["R0"]]
    assert rows[tables.degc.index(25.0)] == pytest.approx(TABLE_OHM[0][4])
    for degc in (7.3, 33.0):
        assert np.interp(degc, tables.degc, rows) == pytest.approx(r0_ohm(degc, 0.5), rel=5e-3)


def test_where_the_samples_do_not_determine_a_table_is_a_caveat():
    result = make_table_result()
    open_nodes = [NodeInterval("OCV [V]", soc, 3.2, 0.0, 0.0, None, None) for soc in (0.0, 0.05)]
    open_nodes.append(NodeInterval("R1 [Ohm]", 0.1, 0.0, 0.0, 0.0, None, 2e-3))
    undetermined = with_fit(result, intervals=(*result.fit.intervals, *open_nodes))
    told = " ".join(tables_of(undetermined).caveats)
    assert "OCV at SOC 0, 0.05." in told
    assert "a capacitance derived from it means nothing on its own: R1 at SOC 0.1." in told
    assert " at SOC 0" not in " ".join(tables_of(result).caveats[1:])


# The modules for PyBaMM and thevenin: their names, their numbers, and what they simulate.


SOC = np.linspace(0, 1, 2001)
# What pybamm.EcmParameters and the Thevenin model ask for (PyBaMM 26.10), beside the pairs.
PYBAMM_NAMES = {
    "chemistry", "Initial SoC", "Initial temperature [K]", "Cell capacity [A.h]",
    "Nominal cell capacity [A.h]", "Ambient temperature [K]", "Current function [A]",
    "Upper voltage cut-off [V]", "Lower voltage cut-off [V]", "Cell thermal mass [J/K]",
    "Cell-jig heat transfer coefficient [W/K]", "Jig thermal mass [J/K]",
    "Jig-air heat transfer coefficient [W/K]", "Open-circuit voltage [V]", "R0 [Ohm]",
    "Entropic change [V/K]",
}  # fmt: skip
# What thevenin's models document (thevenin 0.2), beside the pairs.
THEVENIN_NAMES = {
    "num_RC_pairs", "soc0", "capacity", "ce", "gamma", "mass", "isothermal", "Cp", "T_inf",
    "h_therm", "A_therm", "ocv", "M_hyst", "R0",
}  # fmt: skip


def load(name: str, circuit: str) -> dict[str, Any]:
    return run_module(EXPORTERS[name], make_result(circuit))


@every_circuit
def test_pybamm_gets_the_circuit_under_every_name_it_asks_for_and_no_other(fake_pybamm, circuit):
    module = load("pybamm", circuit)
    pairs = range(1, PAIRS_OF[circuit] + 1)
    names = {f"R{k} [Ohm]" for k in pairs} | {f"C{k} [F]" for k in pairs}
    names |= {f"Element-{k} initial overpotential [V]" for k in pairs}
    assert set(module["get_parameter_values"]()) == PYBAMM_NAMES | names
    assert module["get_model"]() == {"number of rc elements": PAIRS_OF[circuit]}
    values = module["get_parameter_values"]()
    assert values["R0 [Ohm]"] == 0.0511
    for k, (r, c) in enumerate(PAIRS[: PAIRS_OF[circuit]], start=1):
        assert (values[f"R{k} [Ohm]"], values[f"C{k} [F]"]) == (r, c)
    assert values["Cell capacity [A.h]"] == CAPACITY_AH
    assert values["Initial SoC"] == 0.9
    found_v = values["Open-circuit voltage [V]"](SOC)
    assert np.abs(found_v - make_cell().average_ocv_v(SOC)).max() < 1.1 * TOLERANCE_V


@every_circuit
def test_thevenin_gets_every_name_it_asks_for_and_no_other(circuit):
    params = load("thevenin", circuit)["get_params"]()
    pairs = range(1, PAIRS_OF[circuit] + 1)
    assert set(params) == THEVENIN_NAMES | {f"{letter}{k}" for letter in "RC" for k in pairs}
    assert params["num_RC_pairs"] == PAIRS_OF[circuit]
    without = {"iso-rc": 1e5}.get(circuit, 0.0)
    assert params["gamma"] == (GAMMA if circuit in WITH_GAMMA else without)


def run_thevenin(module: dict[str, Any], profile: HeldLoad, step_s: float = np.inf) -> np.ndarray:
    """The documented equations of thevenin, exact for a current held between samples, in steps of
    so many seconds at most."""
    p = module["get_params"]()
    soc, hyst, T_cell = p["soc0"], module["INITIAL_HYSTERESIS_V"], p["T_inf"]
    eta, simulated_v = np.zeros(p["num_RC_pairs"]), []
    pairs = range(1, len(eta) + 1)
    # The fitted time constants are the same at every SOC.
    tau = np.array([p[f"R{k}"](0.3, T_cell) * p[f"C{k}"](0.3, T_cell) for k in pairs])
    for current_a, interval_s in zip(
        profile.current_a, np.diff(profile.time_s, append=profile.time_s[-1]), strict=True
    ):
        simulated_v.append(p["ocv"](soc) + hyst - eta.sum() - current_a * p["R0"](soc, T_cell))
        steps = max(1, round(interval_s / step_s))
        decay, passed = np.exp(-interval_s / steps / tau), current_a * interval_s / steps
        passed /= 3600 * p["capacity"]
        for _ in range(steps):
            level = current_a * np.array([p[f"R{k}"](soc, T_cell) for k in pairs])
            eta = level + (eta - level) * decay
            # M_hyst hardly changes over an interval; half of its way is close enough.
            level_v = -np.sign(current_a) * p["M_hyst"](soc - passed / 2)
            hyst = level_v + (hyst - level_v) * np.exp(-p["gamma"] * abs(passed))
            soc -= passed
    return np.array(simulated_v)


@pytest.mark.parametrize("circuit", ["so-rc", "1rc", "4rc"])
def test_thevenins_equations_give_barnax_voltage_from_the_exported_dictionary(circuit):
    result = make_result(circuit)
    profile = pulse_profile(result)
    here_v = simulate_here(result, profile)
    there_v = run_thevenin(load("thevenin", circuit), profile)
    assert np.abs(there_v - here_v).max() < 1.1 * TOLERANCE_V


def test_a_dynamic_hysteresis_differs_in_thevenin_by_its_slope_over_gamma():
    result = make_result("esc")
    profile = pulse_profile(result)
    here_v = simulate_here(result, profile)
    difference_v = run_thevenin(load("thevenin", "esc"), profile) - here_v
    w = result.cell.hysteresis
    steepest_v = max(abs(w.parameters[name]) for name in "ACEG") / 2
    assert np.abs(difference_v).max() < 1.1 * steepest_v / GAMMA + TOLERANCE_V
    assert np.abs(difference_v).max() > 0.3 * steepest_v / GAMMA


def test_pybamm_gets_interpolants_of_the_tables(fake_pybamm):
    values = run_module(EXPORTERS["pybamm"], make_table_result())["get_parameter_values"]()
    expected_ohm = np.interp(SOC, NODES, TABLE_OHM[0])
    np.testing.assert_allclose(values["R0 [Ohm]"](25.0, 1.0, SOC), expected_ohm)
    tau_s = values["R2 [Ohm]"](25.0, 1.0, SOC) * values["C2 [F]"](25.0, 1.0, SOC)
    np.testing.assert_allclose(tau_s, TABLE_TAU_S[1])
    # A resistance of zero leaves a time constant that no solver divides by.
    assert np.isfinite(values["C1 [F]"](25.0, 1.0, SOC)).all()
    expected_v = make_cell().average_ocv_v(SOC) + np.interp(SOC, NODES, CORRECTION_V)
    found_v = values["Open-circuit voltage [V]"](SOC)
    assert np.abs(found_v - expected_v).max() < 1.1 * TOLERANCE_V


def test_thevenins_functions_of_soc_simulate_what_barnax_does():
    result = make_table_result()
    whole = pulse_profile(result)
    profile = HeldLoad(whole.time_s[:400], whole.current_a[:400])
    there_v = run_thevenin(run_module(EXPORTERS["thevenin"], result), profile, 0.05)
    assert np.abs(there_v - simulate_here(result, profile)).max() < 1e-4


def ocv_at(over_temperature, degc):
    return float(tables_of(over_temperature.at_temperature(degc)).ocv(np.array(0.4)))


def test_thevenin_has_functions_of_soc_and_temperature(over_temperature):
    module = run_module(EXPORTERS["thevenin"], over_temperature)
    for degc in (*DEGC, 33.0, -20.0, 60.0):
        params = module["get_params"](degc)
        inside = min(max(degc, DEGC[0]), DEGC[-1])
        assert params["T_inf"] == pytest.approx(273.15 + degc)
        assert params["R0"](0.4, 273.15 + degc) == pytest.approx(r0_ohm(inside, 0.4), rel=5e-3)
        r1, c1 = (params[name](0.4, 273.15 + degc) for name in ("R1", "C1"))
        assert r1 * c1 == pytest.approx(TABLE_TAU_S[0])
        assert params["ocv"](0.4) == pytest.approx(ocv_at(over_temperature, inside), abs=1e-6)
    # thevenin tries arrays first, and goes one by one after a TypeError.
    with pytest.raises(TypeError):
        params["R0"](np.array([0.4, 0.5]), np.array([298.0, 299.0]))


def test_pybamm_interpolates_over_soc_and_temperature(over_temperature, fake_pybamm):
    values = run_module(EXPORTERS["pybamm"], over_temperature)["get_parameter_values"](45.0)
    assert values["Ambient temperature [K]"] == pytest.approx(318.15)
    for degc in (45.0, 99.0):
        assert values["R0 [Ohm]"](degc, 1.0, 0.4) == pytest.approx(r0_ohm(45.0, 0.4))
    product = values["R2 [Ohm]"](10.0, 1.0, 0.4) * values["C2 [F]"](10.0, 1.0, 0.4)
    assert product == pytest.approx(TABLE_TAU_S[1])
    expected_v = ocv_at(over_temperature, 45.0)
    assert values["Open-circuit voltage [V]"](0.4) == pytest.approx(expected_v, abs=1e-6)
