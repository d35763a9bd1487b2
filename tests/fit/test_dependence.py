"""What resistances follow beside SOC, against cells of which it is known."""

import math
import warnings
from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

import barnax
from barnax import InputError, TableSettings, Window
from barnax.cell import CircuitParameters, Dependence, TemperatureTables
from barnax.cell.dependence import arrhenius_beta, between, heat_of
from barnax.fit.intervals import intervals_of
from barnax.fit.table_problem import reduced_objective
from barnax.model.prepared import prepare_record
from helpers.made_cell import FEW_NODES, R0_OHM, SMALL, TAU_S, cell_with_ocv, made, ocv_v

BETA, REFERENCE_DEGC = 0.06, 10.0


def by_temperature(start_degc, rise_k, beta=BETA):
    """A cell that gets warmer as it is discharged."""

    def driven(time_s, current_a):
        degc = start_degc + rise_k * time_s / time_s[-1]
        flowing_a = np.exp(-beta * (degc - REFERENCE_DEGC)) * current_a
        return degc, flowing_a, flowing_a

    return driven


def by_heat(tau_s, kappa_per_a2, reference_a2):
    """A cell that heats itself, whose temperature nobody measures; the low-pass is SciPy's."""

    def driven(time_s, current_a):
        kept = np.exp(-(time_s[1] - time_s[0]) / tau_s)
        heat_a2 = lfilter([0.0, 1 - kept], [1.0, -kept], current_a**2)
        flowing_a = np.exp(-kappa_per_a2 * (heat_a2 - reference_a2)) * current_a
        return None, flowing_a, flowing_a

    return driven


def by_current(onset_a):
    def driven(time_s, current_a):
        return None, current_a, onset_a * np.arcsinh(current_a / onset_a)

    return driven


def by_direction(ratio):
    """Resistances on charge are so many times those on discharge."""

    def driven(time_s, current_a):
        flowing_a = current_a * np.where(current_a < 0, ratio, 1.0)
        return None, flowing_a, flowing_a

    return driven


def identified(records, **options):
    window = Window(initial_soc=1.0, capacity_ah=2.0)
    return barnax.identify(records, window=window, **SMALL, keep_starts=True, **options)


def interval(fit, name):
    (actual,) = (each for each in fit.intervals if each.name == name and each.soc is None)
    return actual


@pytest.fixture(scope="module")
def warming():
    """Two drives of one cell at different temperatures."""
    degc = [(5.0, 10.0), (9.0, 3.0)]
    return [made(seed, driven=by_temperature(*each))[0] for seed, each in enumerate(degc)]


@pytest.fixture(scope="module")
def followed(warming):
    """By what they follow; that it is chosen among all laws is a slow test."""
    return identified(warming, resistances_follow="temperature", nodes=FEW_NODES)


def test_a_beta_of_the_measured_temperature_is_identified(followed):
    fit = followed.fit
    known = fit.tables.dependence
    assert known.beta_per_k == pytest.approx(BETA, rel=0.03)
    assert (known.heating_tau_s, known.onset_a) == (None, None)
    actual = interval(fit, "beta [1/K]")
    assert actual.low < BETA < actual.high
    true_ohm = R0_OHM * np.exp(-BETA * (known.reference_degc - REFERENCE_DEGC))
    own = [each for each in fit.of_table("R0 [Ohm]") if each.low is not None]
    np.testing.assert_allclose([each.value for each in own], true_ohm, rtol=0.02)
    # Its numbers have no proof, and the result says so.
    assert fit.status == "grid-verified"


def test_it_comes_back_and_predicts_another_temperature(followed):
    again = barnax.Result.model_validate_json(followed.to_json())
    assert again.fit.tables == followed.fit.tables
    other, _ = made(7, driven=by_temperature(18.0, 4.0))
    window = Window(initial_soc=1.0, capacity_ah=2.0)
    near = again.validate(other, window)
    assert near.metrics.rmse_v < 1.5e-3
    # Where a sensor fails, its neighbors are taken.
    failing_degc = np.where(np.arange(other.samples) % 1000 == 7, 6553.5, other.temperature_degc)
    failing = again.validate(replace(other, temperature_degc=failing_degc), window)
    assert failing.metrics.rmse_v == pytest.approx(near.metrics.rmse_v, rel=1e-3)
    # Where it does not know the temperature, it says what it takes.
    far = again.validate(replace(other, temperature_degc=None), window)
    assert far.metrics.rmse_v > 3 * near.metrics.rmse_v
    assert "tables.no-temperature" in [each.code for each in far.warnings]
    assert "tables.no-temperature" not in [each.code for each in near.warnings]
    # Its name may tell one.
    named = replace(other, name="u20degC.csv", temperature_degc=None)
    assert again.validate(named, window).metrics.rmse_v < 0.3 * far.metrics.rmse_v


def test_a_simulation_follows_the_temperature_that_it_is_given(followed):
    record, soc = made(7, driven=by_temperature(18.0, 4.0))
    frame = {
        "Time [s]": record.time_s,
        "Current [A]": record.current_a,
        "Temperature [degC]": record.temperature_degc,
    }
    with warnings.catch_warnings(action="ignore"):
        actual = followed.simulate(frame, initial_soc=float(soc[0]))
    assert np.sqrt(np.mean((actual["Voltage [V]"] - record.voltage_v) ** 2)) < 1.5e-3
    # A temperature that is given beside another in the column is warned of.
    given_degc = next(degc for _, degc in followed.measured_at if degc is not None)
    frame["Temperature [degC]"] = record.temperature_degc + 20.0
    with warnings.catch_warnings(record=True, action="always") as warned:
        followed.simulate(frame, initial_soc=float(soc[0]), temperature=given_degc)
    assert any("in the middle, and" in str(each.message) for each in warned)


@pytest.mark.slow
def test_without_such_a_cell_nothing_is_followed():
    """Temperatures that change nothing, and none at all."""
    idle = [made(seed, driven=by_temperature(5.0, 8.0, beta=0.0))[0] for seed in range(2)]
    plain = [made(seed)[0] for seed in range(2)]
    for records in (idle, plain):
        assert identified(records).fit.tables.dependence is None


@pytest.mark.slow
def test_the_measured_temperature_is_chosen_and_none_is_asked_for_and_taken(warming, followed):
    chosen = identified(warming).fit
    assert chosen.tables.dependence.numbers.keys() == {"beta [1/K]"}
    beta_per_k = followed.fit.tables.dependence.beta_per_k
    assert chosen.tables.dependence.beta_per_k == pytest.approx(beta_per_k, rel=1e-3)
    fit = identified(warming, resistances_follow="none").fit
    assert fit.tables.dependence is None
    held = chosen.cross_validation
    assert fit.cross_validation.tables.rmse_v > 2 * held.tables.rmse_v


@pytest.mark.slow
def test_self_heating_is_identified_from_several_records():
    driven = by_heat(1500.0, 0.25, 0.9)
    # One drives harder, so that it is warmer at the same SOC.
    records = [made(seed, driven=driven, hours=hours)[0] for seed, hours in ((0, 2.5), (1, 1.5))]
    known = identified(records).fit.tables.dependence
    assert known.kappa_per_a2 == pytest.approx(0.25, rel=0.25)
    assert known.heating_tau_s == pytest.approx(1500.0, rel=0.4)


@pytest.mark.slow
def test_a_current_of_butler_and_volmer_is_identified():
    records = [made(seed, driven=by_current(0.8))[0] for seed in range(2)]
    known = identified(records).fit.tables.dependence
    assert known.onset_a == pytest.approx(0.8, rel=0.1)
    assert known.numbers.keys() == {"i0 [A]"}


@pytest.mark.slow
@pytest.mark.parametrize("ratio", [1.0, 1.3])
def test_resistances_that_differ_with_the_direction_are_identified_from_one_record(ratio):
    """Else an OCV of the record's own is too high by half the difference."""
    record = made(driven=by_direction(ratio))[0]
    fit = identified([record]).fit
    known = fit.tables.dependence
    # Left out, they are warned of.
    codes = [one.code for one in identified([record], resistances_follow="none").warnings]
    assert ("tables.direction-left-out" in codes) is (ratio != 1)
    if ratio == 1:
        assert known is None
    else:
        assert known.charge_ratio == pytest.approx(ratio, rel=0.01)
        actual = interval(fit, "charge ratio")
        assert actual.low < ratio < actual.high
        r0_ohm = [each.value for each in fit.of_table("R0 [Ohm]") if each.low is not None]
        np.testing.assert_allclose(r0_ohm, R0_OHM * math.sqrt(ratio), rtol=0.02)
    apart_v = [
        each.value - ocv_v(each.soc) for each in fit.of_table("OCV [V]") if each.low is not None
    ]
    assert abs(np.median(apart_v)) < 1e-3


def test_beside_an_ocv_test_a_switched_hysteresis_is_no_difference_of_resistances():
    """A test of one direction leaves it to the records, where it looks the same."""
    record, _ = made()
    soc = np.linspace(0.0, 1.0, 201)
    test = {"SOC": soc, "OCV [V]": ocv_v(soc) - 0.01}
    moving = np.flatnonzero(record.current_a)
    last = moving[np.maximum(np.searchsorted(moving, np.arange(record.samples), "right") - 1, 0)]
    voltage_v = record.voltage_v - 0.01 * np.sign(record.current_a[last])
    known = identified([replace(record, voltage_v=voltage_v)], ocv=test).fit.tables.dependence
    assert known is None


def test_a_record_that_only_discharges_tells_no_difference_of_resistances():
    record = made(scale=0.7)[0]
    record = replace(record, current_a=np.abs(record.current_a))
    with pytest.raises(InputError, match="hardly a current flows in one of the directions"):
        identified([record], resistances_follow="direction")


@pytest.mark.parametrize("kappa_per_a2", [1e-6, 1e-5])
def test_what_may_be_anything_has_no_interval(kappa_per_a2):
    """A heat so weak that no sample tells its logarithm."""
    record, _ = made(noise_v=5e-3)
    prepared = prepare_record(record, cell_with_ocv(), "so-rc", Window(initial_soc=1.0))
    weak = Dependence(kappa_per_a2=kappa_per_a2, heating_tau_s=1000.0)
    held = {"tau1 [s]": (TAU_S[0],) * 2, "tau2 [s]": (TAU_S[1],) * 2}
    objective = reduced_objective([prepared.with_dependence(weak)], TableSettings(), held)
    best = objective.solve(tuple(math.log(low) for low, _ in held.values()))
    (actual,) = (each for each in intervals_of(objective, best) if each.name == "kappa [1/A2]")
    assert (actual.low, actual.high, actual.standard_error) == (None, None, 0.0)


def test_a_temperature_that_nobody_measured_cannot_be_followed():
    record, _ = made()
    with pytest.raises(InputError, match=r"made0.csv: has no column of temperatures.*'heating'"):
        identified([record], resistances_follow="temperature")


def test_heat_is_the_low_passed_square():
    """Closed form of a constant current, on an uneven clock."""
    time_s = np.cumsum(np.random.default_rng(0).uniform(0.1, 30.0, 400))
    actual = heat_of(time_s, np.full(399, 3.0), 250.0)
    np.testing.assert_allclose(actual, 9 * -np.expm1(-(time_s - time_s[0]) / 250.0), rtol=1e-12)


def test_between_two_temperatures_what_is_followed_changes_without_a_jump():
    def tables_of(*laws):
        rows = (0.5,), (60.0,), (0.05,), ((0.01,),)
        tables = (CircuitParameters.over_soc(*rows, dependence=law) for law in laws)
        return TemperatureTables((0.0, 40.0), tuple(tables))

    cold, warm = (Dependence(beta_per_k=arrhenius_beta(x), reference_degc=x) for x in (0.0, 40.0))
    tables = tables_of(cold, warm)
    middle = tables.at(20.0).dependence
    assert middle.reference_degc == 20.0
    assert warm.beta_per_k < middle.beta_per_k < cold.beta_per_k
    assert middle.factor(np.zeros(1), np.zeros(0), np.array([20.0])) == pytest.approx(1.0)
    one_way = between(Dependence(charge_ratio=1.44), None, 20.0, 0.5)
    assert one_way.charge_ratio == pytest.approx(1.2)
    for degc, share in ((20.0, 0.5), (39.999, 0.0)):
        law = tables_of(cold, None).at(degc).dependence
        assert law.beta_per_k == pytest.approx(share * cold.beta_per_k, abs=1e-5)
