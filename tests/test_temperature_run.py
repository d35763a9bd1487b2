"""Tables over SOC and temperature from records to the screen: a made cell comes back."""

import csv

import numpy as np
import pytest

from barnax import InputError, Result, hppc
from barnax.cell.parameters import OCV_CORRECTION
from barnax.experiment.prior import prior_of_result
from barnax.reporting.first_screen import first_screen
from barnax.reporting.identification import identification_document
from barnax.reporting.parameters import tables_csv
from barnax.reporting.render import to_markdown
from barnax.reporting.wording import sentences
from helpers.pulse_tests import CAPACITY_AH, TAU_S, made_record, r0_ohm
from helpers.report_reader import screen_of

NODES = (0.0, 0.25, 0.5, 0.75, 1.0)
DEGC = (5.0, 25.0, 45.0)


def arrhenius(degc):
    return float(np.exp(2500 / (273.15 + degc) - 2500 / 298.15))


def at(degc):
    return made_record(2.0, factor=arrhenius(degc), degc=degc, lift_v=1e-3 * (degc - 25))


@pytest.fixture(scope="module")
def result() -> Result:
    quick = {"max_boxes": 0, "folds": 0, "seeds": 0, "trust": "none", "resistances_follow": "none"}
    given = {"validate": at(15.0), "capacity": CAPACITY_AH, "nodes": NODES}
    return hppc([at(degc) for degc in DEGC], **given, **quick)


def test_a_design_knows_only_what_was_measured_at_its_temperature(result):
    cold, between = (prior_of_result(result, degc) for degc in (5.0, 35.0))
    own = {(each.name, each.soc): each.value for each in result.tables.fits[0].intervals}
    assert cold.tables.at("R0 [Ohm]", np.array([0.5]))[0] == own["R0 [Ohm]", 0.5]
    assert set(cold.half_widths) <= set(own)
    assert cold.half_widths
    assert not between.half_widths
    assert np.all(between.worst == 2.0)
    with pytest.raises(InputError, match="one temperature"):
        prior_of_result(result.at_temperature(5.0), 5.0)


def test_each_temperature_has_the_resistances_of_the_cell(result):
    part = result.tables
    assert part.over_temperature.temperatures_degc == DEGC
    for degc, fit in zip(DEGC, part.fits, strict=True):
        assert fit.tables.tau_s == pytest.approx(TAU_S, rel=0.03)
        own = fit.tables.at("R0 [Ohm]", np.array([0.25, 0.5, 0.75]))
        true = arrhenius(degc) * r0_ohm(np.array([0.25, 0.5, 0.75]))
        assert own == pytest.approx(true, rel=0.02)
    between = result.fits.at(15.0).at("R0 [Ohm]", np.array([0.5]))[0]
    assert between == pytest.approx(arrhenius(15.0) * r0_ohm(0.5), rel=0.02)
    assert result.metrics.validation[0].rmse_v < 1e-3


def test_an_error_of_a_temperature_left_out_stands_beside_what_was_not_measured(result):
    text = screen_of(first_screen(result))
    left = result.tables.over_temperature.left_out[1]
    assert left.is_between
    assert f"{1e3 * left.errors.rmse_v:#.3g}" in text
    assert "its tables lie between those of 5 degC and 25 degC" in " ".join(text.split())
    for degc in DEGC:
        assert any(line.split()[:2] == [f"{degc:g}", "degC"] for line in text.splitlines())
    assert not sentences("tables.prediction", result.fits, "x", 26.0)
    assert "are those of 45 degC" in sentences("tables.prediction", result.fits, "x", 60.0)[0]


def test_what_is_stored_says_the_same_and_takes_a_record_at_its_temperature(result):
    again = Result.model_validate_json(result.to_json())
    assert again.tables == result.tables
    assert screen_of(first_screen(again)) == screen_of(first_screen(result))
    report = to_markdown(identification_document(again))
    assert "Tables over SOC and temperature" in report
    assert "The tables at 45 degC" in report
    evaluation = again.validate(at(15.0))
    assert evaluation.metrics.rmse_v == pytest.approx(result.metrics.validation[0].rmse_v)
    prepared = evaluation.prepared
    given = {"initial_soc": prepared.start.soc, "temperature": 15.0}
    simulated = again.simulate(prepared.current_a, prepared.time_s, **given)
    assert simulated["Voltage [V]"] == pytest.approx(evaluation.simulated_v, abs=1e-9)
    with pytest.raises(InputError, match="known from 5 to 45 degC, not at 60 degC"):
        again.simulate(prepared.current_a, prepared.time_s, temperature=60.0)
    assert set(again.to_frame()["temperature [degC]"]) == set(DEGC)
    rows = list(csv.DictReader(tables_csv(again.fits).decode().splitlines()))
    assert {float(row["temperature [degC]"]) for row in rows} == set(DEGC)


def test_each_temperature_has_the_ocv_of_its_test(result):
    for degc in (*DEGC, 15.0):
        own_v = result.cell.at(degc).average_ocv_v(np.array([0.1, 0.5]))
        assert own_v == pytest.approx(3.2 + (0.875 + 1e-3 * degc) * np.array([0.1, 0.5]), abs=1e-5)
    # So no correction is left to make.
    for fit in result.tables.fits:
        assert np.abs(fit.tables.tables[OCV_CORRECTION]).max() < 1e-3
