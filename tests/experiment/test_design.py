"""A designed test: what it promises, what it keeps, and the forms it is given in."""

import csv
import re
from dataclasses import replace
from functools import cache
from typing import Any

import jax
import numpy as np
import pytest
from scipy.linalg import toeplitz

import barnax
from barnax import Block, InputError
from barnax.experiment.information import columns_of, information_of, widths_of
from barnax.experiment.prior import prior_of_chemistry
from barnax.experiment.protocol import sampled, voltage_along
from barnax.reporting.design_forms import procedure, profile_csv, pybamm_steps, steps_csv
from helpers.designs import quick_design

LIMITS: dict[str, Any] = {"max_discharge": 2.0, "max_charge": 1.0}
PULSED = {**LIMITS, "capacity": 2.0, "max_hours": 1.8, "want": {"R0": 0.01}}
WARMING = {"capacity": 2.0, "max_warming": 0.3, "max_hours": 2.0}


@cache
def few_blocks():
    """A few of the default ones, so that a search is short."""
    names = ("short pulses", "binary 4 s", "long pulse")
    return [block for block in barnax.candidate_blocks(jax.random.key(0)) if block.name in names]


@pytest.fixture(scope="module")
def pulsed():
    # Moves and rests alone do not tell R0 so well.
    return quick_design(**PULSED, blocks=few_blocks())


@pytest.fixture(scope="module")
def prior():
    return prior_of_chemistry("nmc", 2.0)


def test_columns_are_the_derivatives_of_the_voltage(prior):
    test = prior.loaded(np.repeat([0.0, 3.0, -1.0, 0.5], 40), 0.62)
    columns = columns_of(prior, test)
    nodes = prior.settings.nodes
    for row in range(1 + prior.tables.pairs):
        place = row * len(nodes) + nodes.index(0.6)
        changed = []
        for step in (1e-3, -1e-3):
            moved = prior.tables.ohm[row]
            moved[nodes.index(0.6)] += step
            tables = prior.tables.with_tables({prior.tables.resistances[row]: moved})
            changed.append(voltage_along(replace(prior, tables=tables), test))
        slope = (changed[0] - changed[1]) / 2e-3
        np.testing.assert_allclose(columns[:, place], -slope, atol=1e-9)


def test_columns_are_the_derivatives_by_time_constants_and_the_ocv(prior):
    test, step = prior.loaded(np.repeat([0.0, 3.0, -1.0, 0.5], 40), 0.62), 1e-4
    columns = columns_of(prior, test)[:, : len(prior.names)]
    for pair, (name, tau_s) in enumerate(prior.tables.named_tau_s.items()):
        voltages_v = []
        for sign in (1, -1):
            scales = {**prior.tables.scales, name: tau_s * np.exp(sign * step)}
            moved = replace(prior, tables=replace(prior.tables, scales=scales))
            voltages_v.append(voltage_along(moved, test))
        slope = (voltages_v[0] - voltages_v[1]) / (2 * step)
        np.testing.assert_allclose(columns[:, pair - prior.tables.pairs], -slope, atol=1e-9)
    of_ocv = columns[:, prior.tables_of_names["OCV [V]"]]
    np.testing.assert_allclose(of_ocv.sum(axis=1), -1.0, atol=1e-12)


@pytest.mark.parametrize(("time_s", "tolerance"), [(0, 1e-12), (10, 1e-12), (200, 5e-3)])
def test_the_noise_of_products_is_that_of_the_whole_covariance(prior, time_s, tolerance):
    test = prior.loaded(np.repeat([0.0, 2.0, -1.0], 400), 0.5)
    columns = columns_of(prior, test)
    error = replace(prior.error, noise=((time_s, 3e-3),))
    actual = information_of(replace(prior, error=error), test)
    lags = np.arange(len(columns))
    covariance = toeplitz(9e-6 * (np.exp(-lags / time_s) if time_s else lags == 0))
    own = columns[:, : len(prior.names)]
    expected = own.T @ covariance @ own
    np.testing.assert_allclose(actual.noise, expected, atol=tolerance * np.abs(expected).max())


def test_the_error_on_a_drive_is_that_of_fits_to_cells_that_are_no_circuits(prior):
    rng = np.random.default_rng(1)
    quiet = replace(prior, error=replace(prior.error, noise=(), left_out=2.0))
    test_a, drive_a = (np.repeat(rng.uniform(-2, 4, 300), 20) for _ in range(2))
    count = len(quiet.names)
    test, drive = (quiet.loaded(each, 1.0) for each in (test_a, drive_a))
    on_test, on_drive = columns_of(quiet, test), columns_of(quiet, drive)
    actual = information_of(quiet, test)
    inverse = actual.inverse(quiet)
    left_v = actual.left_on(quiet, inverse, on_drive.T @ on_drive / len(on_drive))
    squares = []
    for _ in range(300):
        # The cell is off what is believed, and more than its circuit.
        tables = quiet.unseen * rng.normal(size=count)
        cell = np.append(tables, rng.normal(size=on_test.shape[1] - count))
        fitted = inverse @ (on_test[:, :count].T @ (on_test @ cell))
        squares.append(np.mean((on_drive @ cell - on_drive[:, :count] @ fitted) ** 2))
    assert left_v == pytest.approx(np.sqrt(np.mean(squares)), rel=0.1)


def test_a_design_keeps_its_time_and_its_limits(pulsed):
    assert pulsed.hours <= 1.8
    predicted, limits = pulsed.predicted, pulsed.limits
    current_a = [step.current_a for step in pulsed.steps]
    assert max(current_a) <= 2 * 2.0 + 1e-6
    assert min(current_a) >= -2 * 1.0 - 1e-6
    ending = ("to empty", "last rest")
    loaded_s = sum(step.duration_s for step in pulsed.steps if step.block not in ending)
    counted = int(np.searchsorted(predicted.time_s, loaded_s)) + 1
    assert predicted.low_v[:counted].min() >= limits.low_v
    charging = predicted.current_a[:counted] < 0
    assert predicted.high_v[:counted][charging].max(initial=0.0) <= limits.high_v
    assert predicted.soc.min() >= -1e-4
    # Loads end at 10 % SOC where the OCV is unknown; what is left is taken out slowly.
    assert predicted.soc[:counted].min() >= 0.1 - 1e-4
    (emptying,) = [step for step in pulsed.steps if step.block == "to empty"]
    assert emptying.current_a < 0.34 * 2.0
    assert predicted.soc.max() <= 1


def test_lines_between_what_is_stored_of_a_prediction_are_its_voltage(pulsed, prior):
    predicted, current_a = pulsed.predicted, sampled(pulsed.steps)
    voltage_v = voltage_along(prior, prior.loaded(current_a, pulsed.initial_soc))
    ends = np.cumsum([round(step.duration_s) for step in pulsed.steps])
    inside = np.setdiff1d(np.arange(1, len(voltage_v)), [*ends, *(ends - 1)])
    drawn_v = np.interp(inside, predicted.time_s, predicted.voltage_v)
    np.testing.assert_allclose(drawn_v, voltage_v[inside], atol=4e-3)


@pytest.mark.slow
def test_rates_over_soc_hold_for_pieces_that_leave_their_stretch():
    taken = [
        Block("charge", (300.0, 60.0), (-1.0, 0.0)),
        Block("pulse", (180.0, 300.0), (1.0, 0.0)),
    ]
    discharge, charge = [(0.0, 0.1), (0.5, 2.0)], [(0.3, 1.0), (1.0, 0.05)]
    limits = {"max_discharge": discharge, "max_charge": charge, "max_hours": 5.0}
    actual = barnax.design(capacity=0.002, blocks=taken, starts=1, **limits)
    current_a = sampled(actual.steps)
    soc = 1 - np.append(0.0, np.cumsum(current_a[:-1])) / 3600 / 0.002
    assert np.all(current_a <= 1.001 * 0.002 * np.interp(soc, *np.transpose(discharge)))
    assert np.all(-current_a <= 1.001 * 0.002 * np.interp(soc, *np.transpose(charge)))
    # The steps of a small cell have as many digits as those of a large one.
    rows = csv.DictReader(steps_csv(actual).splitlines())
    written = [float(row["Current / A"]) for row in rows]
    np.testing.assert_allclose(written, [abs(step.current_a) for step in actual.steps], rtol=1e-4)


def test_earlier_records_narrow_what_a_test_leaves(prior):
    current_a = np.tile(np.repeat([2.0, -1.0], 30), 20)
    earlier = [prior.loaded(current_a[::-1], 0.6)]
    prior = replace(prior, earlier=earlier, half_widths={("R1 [Ohm]", 0.6): 0.2})
    of_test = information_of(prior, prior.loaded(current_a, 0.6))
    widths = widths_of(prior, of_test)
    (width,) = [each for each in widths if (each.name, each.soc) == ("R1 [Ohm]", 0.6)]
    assert 0.5 * width.alone < width.after < 0.9 * width.alone
    # A record of the same charge tells as much as the test.
    assert width.before == pytest.approx(width.alone, rel=0.3)
    without = widths_of(replace(prior, earlier=[]), of_test)
    assert [each.before for each in without if (each.name, each.soc) == ("R1 [Ohm]", 0.6)] == [0.2]


def test_all_forms_hold_the_same_current(pulsed, tmp_path):
    rows = list(csv.DictReader(steps_csv(pulsed).splitlines()))
    sign = {"rest": 0, "discharge": 1, "charge": -1}
    signed = [sign[row["Mode"]] * float(row["Current / A"]) for row in rows]
    np.testing.assert_allclose(signed, [step.current_a for step in pulsed.steps], atol=1e-4)
    profile = np.array([row.split(",")[1] for row in profile_csv(pulsed).split()[5:]], float)
    # All forms discharge until the voltage, for as long at most.
    twice = [1 + (step.block == "to empty") for step in pulsed.steps]
    charges = [step.duration_s * step.current_a / 3600 for step in pulsed.steps]
    assert profile[:-1].sum() / 3600 == pytest.approx(np.dot(twice, charges), abs=2e-3)
    assert pybamm_steps(pulsed)[-2].startswith(f"Discharge at {float(rows[-2]['Current / A']):g} A")
    (expected,) = [step.duration_s for step in pulsed.steps if step.block == "to empty"]
    assert float(rows[-2]["Duration / s"]) == 2 * expected
    assert f"for {2 * expected:g} seconds or until 2.5 V" in pybamm_steps(pulsed)[-2]
    most_s = sum(float(row["Duration / s"]) for row in rows)
    assert len(profile) == most_s + 1
    assert f"{pulsed.hours:.2f} h expected, {most_s / 3600:.2f} h at most" in procedure(pulsed)
    ends = {row["Piece"]: row["At the lowest voltage"] for row in rows}
    assert {name for name, end in ends.items() if end == "next step"} == {"to empty"}
    assert min(float(row["SOC at the end"]) for row in rows) == 0.0
    assert "-0.0" not in steps_csv(pulsed)
    # Neighboring rests are one, as where a full cell cannot be charged.
    assert not re.search(r"rest \d+ s; rest", procedure(pulsed))
    assert len(pybamm_steps(pulsed)) == len(pulsed.steps)
    (tmp_path / "design.json").write_text(pulsed.to_json())
    assert barnax.Design.load(tmp_path).steps == pulsed.steps


@pytest.mark.parametrize(
    ("asked", "words"),
    [
        ({}, "`capacity`"),
        ({"capacity": 2.0, "chemistry": "lto"}, "nmc, lfp"),
        ({"capacity": 2.0, "max_hours": 0.5}, "`max_discharge`"),
        ({"capacity": 2.0, "want": {"R7": 0.1}}, "R0, R1, R2, OCV"),
        ({"capacity": 2.0, "want": {"R0": 2.0}}, "under 1"),
        ({"capacity": 2.0, "want": {}}, "`want`"),
        ({"capacity": 2.0, "temperature": -10.0}, "typical of 25 degC"),
        ({"capacity": 2.0, "max_discharge": 0.0}, "`max_discharge`: a test discharges the cell"),
        pytest.param(WARMING, "larger `max_warming`", marks=pytest.mark.slow),
        ({"capacity": 2.0, "chemistry": "lfp", "high_voltage": 3.5}, r"3\.578 V if the cell's"),
        ({"capacity": 2.0, "max_discharge": float("nan")}, "`max_discharge` nan"),
        ({"capacity": 2.0, "max_charge": [(80.0, 1.0)]}, "from 0 to 1"),
        ({"capacity": 2.0, "low_voltage": 4.2, "high_voltage": 2.5}, "under `high_voltage`"),
    ],
)
def test_what_cannot_be_is_refused_with_what_to_do(asked, words):
    with pytest.raises(InputError, match=words):
        quick_design(**asked, blocks=few_blocks())


@pytest.mark.slow
def test_the_same_key_gives_the_same_design(pulsed):
    assert quick_design(**PULSED, blocks=few_blocks()).to_json() == pulsed.to_json()
    blocks, others = (barnax.candidate_blocks(jax.random.key(key)) for key in (0, 1))
    assert blocks != others


@pytest.mark.slow
def test_a_wish_that_is_easy_takes_the_least_time_whatever_is_given():
    """The best of a long test has more pieces than fit into a short one."""
    hours = []
    for max_hours in (1.6, 3.0):
        actual = barnax.design(
            capacity=2.0, max_hours=max_hours, want={"R0": 0.05}, blocks=few_blocks(), **LIMITS
        )
        assert actual.is_reached
        hours.append(actual.hours)
    assert hours[1] < 1.1 * hours[0]
