"""Tables at several temperatures with shared time constants: made cells, and a measured one."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import minimize

from barnax import CircuitParameters, InputError, TableSettings
from barnax.fit.table_fit import fit_tables, pooled_errors
from barnax.fit.temperature import fit_temperatures, group_by_temperature
from barnax.model.reference import simulate_circuit

from .conftest import NODES, SMALL

DEGC = (0.0, 20.0, 40.0)
LIGHT = replace(SMALL, roughness=1e-12, resistance_ridge=1e-15, voltage_ridge=1e-15)


def made(prepared, degc, factor, tau_s=(9.0, 90.0)):
    """The record as a cell would have answered whose resistances are so many times as high."""
    shape = factor * np.array([1.3, 1.1, 1.0, 1.0, 1.05])
    tables = CircuitParameters.over_soc(
        nodes=NODES,
        tau_s=tau_s,
        r0_ohm=tuple(0.04 * shape),
        r_ohm=(tuple(0.01 * shape), tuple(0.02 * shape)),
        ocv_correction_v=(0.0,) * len(NODES),
    )
    record, voltage_v = prepared.record, prepared.record.voltage_v.copy()
    voltage_v[prepared.span] = simulate_circuit(prepared, tables)
    return replace(
        prepared,
        record=replace(record, voltage_v=voltage_v),
        window=replace(prepared.window, temperature_degc=degc),
    )


def arrhenius(degc):
    return float(np.exp(2500 / (273.15 + degc) - 2500 / 293.15))


def test_a_made_cell_comes_back_and_a_temperature_left_out_is_predicted(prepared):
    cells = {degc: [made(prepared, degc, arrhenius(degc))] for degc in DEGC}
    fit = fit_temperatures(cells, LIGHT)
    assert fit.tables.tables[0].tau_s == pytest.approx((9.0, 90.0), rel=1e-4)
    for degc, tables in zip(DEGC, fit.tables.tables, strict=True):
        true_ohm = 0.04 * arrhenius(degc) * np.array([1.3, 1.1, 1.0, 1.0, 1.05])
        seen = np.array(tables.visited)
        assert tables.ohm[0][seen] == pytest.approx(true_ohm[seen], rel=1e-3)
    cold, middle, warm = fit.over_temperature.left_out
    assert (cold.is_between, middle.is_between, warm.is_between) == (False, True, False)
    assert middle.errors.rmse_v < 1e-5 < 1e-3 < min(cold.errors.rmse_v, warm.errors.rmse_v)
    assert fit.over_temperature.reversals == ()


@pytest.mark.slow
def test_shared_time_constants_are_the_least_of_the_weighted_sum(prepared):
    """Nelder and Mead on the sum of what `fit_tables` gives with held time constants."""
    cells = {degc: [made(prepared, degc, arrhenius(degc))] for degc in (0.0, 40.0)}
    cells[40.0] = [replace(cells[40.0][0], scored=np.arange(len(prepared.soc)) > 1500)]
    own_v = np.random.default_rng(0).normal(0, 1e-3, len(cells[0.0][0].soc))
    noisy = cells[0.0][0].record.voltage_v.copy()
    noisy[cells[0.0][0].span] += np.convolve(own_v, np.ones(30), "same")
    cells[0.0] = [replace(cells[0.0][0], record=replace(cells[0.0][0].record, voltage_v=noisy))]
    fit = fit_temperatures(cells, SMALL)
    scored = np.array([np.sum(cells[degc][0].scored) for degc in (0.0, 40.0)])

    def mean_square(place):
        fixed = {"tau1 [s]": float(np.exp(place[0])), "tau2 [s]": float(np.exp(place[1]))}
        held = replace(SMALL, bounds={}, fixed=fixed)
        roots = [fit_tables(cells[degc], held).objective_v for degc in (0.0, 40.0)]
        return float(scored @ np.square(roots) / scored.sum())

    start = np.log(fit.tables.tables[0].tau_s)
    assert fit.over_temperature.objective_v**2 == pytest.approx(mean_square(start), rel=1e-9)
    actual = minimize(mean_square, start, method="Nelder-Mead", options={"maxfev": 15})
    assert fit.over_temperature.objective_v**2 <= actual.fun * (1 + 1e-6)
    assert fit.over_temperature.separate_v <= fit.over_temperature.objective_v * (1 + 1e-12)


@pytest.mark.slow
def test_shared_time_constants_are_proved_as_closely_where_sharing_them_costs(prepared):
    times_s = {0.0: (9.0, 90.0), 40.0: (13.0, 130.0)}
    cells = {degc: [made(prepared, degc, 1.0, tau_s)] for degc, tau_s in times_s.items()}
    around = {"tau1 [s]": (8.0, 14.0), "tau2 [s]": (80.0, 140.0)}
    settings = replace(SMALL, bounds=around, proved_share=0.02, max_boxes=1000)
    over = fit_temperatures(cells, settings).over_temperature
    assert over.separate_v < 0.97 * over.objective_v
    assert 0.98 * over.objective_v <= over.lower_bound_v <= over.objective_v


def test_a_resistance_that_falls_and_rises_is_named(prepared):
    cells = {degc: [made(prepared, degc, f)] for degc, f in zip(DEGC, (1.5, 1.0, 1.2), strict=True)}
    actual = fit_temperatures(cells, LIGHT).over_temperature.reversals
    r0 = [each for each in actual if each.name == "R0 [Ohm]"]
    assert r0
    assert r0[-1].values_ohm == pytest.approx(
        np.interp(r0[-1].soc, NODES, [1.3, 1.1, 1.0, 1.0, 1.05]) * np.array([0.06, 0.04, 0.048]),
        rel=1e-3,
    )


def test_records_are_grouped_by_their_given_or_measured_temperature(prepared):
    def at(degc):
        return replace(prepared, window=replace(prepared.window, temperature_degc=degc))

    measured_degc = np.full(prepared.record.samples, 22.0)
    measured_degc[: prepared.first] = 50.0
    measured_degc[-1] = np.nan
    measured = replace(prepared, record=replace(prepared.record, temperature_degc=measured_degc))
    groups = group_by_temperature([at(40.0), measured, at(24.0)])
    assert {degc: len(group) for degc, group in groups.items()} == {23.0: 2, 40.0: 1}
    with pytest.raises(InputError, match="`temperature`"):
        group_by_temperature([prepared])
    with pytest.raises(InputError, match="two temperatures"):
        fit_temperatures({25.0: [prepared]}, SMALL)


# Around the accepted optima, so that a factor is small.
AROUND = {"tau1 [s]": (5.0, 20.0), "tau2 [s]": (40.0, 100.0)}


@pytest.mark.slow
def test_measured_temperatures_share_time_constants_at_no_cost(samsung):
    """Accepted: sqrt(J) of 7.6276, 5.9566 and 3.9784 mV with time constants of their own; 25 degC
    is predicted by the others to about 20 mV above 10 % SOC, for R0 is not monotone."""

    def prepared(name, degc):
        return samsung(f"{name}_{degc}degC_80soc", temperature_degc=float(degc))

    cells = {float(degc): [prepared("dst", degc)] for degc in (0, 25, 45)}
    settings = TableSettings(bounds=AROUND, folds=0, max_boxes=0, rising_ocv=False)
    fit = fit_temperatures(cells, settings)
    scored = np.array([np.sum(each.scored) for own in cells.values() for each in own])
    own_v = np.array([7.6276e-3, 5.9566e-3, 3.9784e-3])
    assert fit.over_temperature.separate_v**2 == pytest.approx(
        scored @ own_v**2 / scored.sum(), rel=1e-3
    )
    assert fit.over_temperature.objective_v <= 1.02 * fit.over_temperature.separate_v
    middle_ohm = [1e3 * each.at("R0 [Ohm]", np.array([0.5]))[0] for each in fit.tables.tables]
    assert middle_ohm == pytest.approx((101, 70.5, 77), abs=0.6)
    assert ("R0 [Ohm]", 0.5) in {(each.name, each.soc) for each in fit.over_temperature.reversals}
    assert fit.over_temperature.left_out[1].errors.above_v is not None
    assert 0.018 < fit.over_temperature.left_out[1].errors.above_v < 0.024
    # A record nobody has seen, at a measured temperature, has that one's tables.
    assert fit.over_temperature.measured_near(43.0) == 45.0
    actual = pooled_errors([prepared("us06", 45)], fit.at(43.0))
    assert actual.rmse_v == pytest.approx(16.1e-3, rel=0.1)
