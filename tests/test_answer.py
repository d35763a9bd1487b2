"""The answer of the bundled cell and of simulated ones: what was chosen, and what stands beside."""

from dataclasses import replace

import numpy as np
import pytest

import barnax
from barnax import CircuitParameters, Job, Result, Window
from barnax.fit.cross_validation import SocErrors
from barnax.model.prepared import prepare_record
from barnax.model.reference import simulate_circuit
from barnax.reporting.first_screen import first_screen
from barnax.uncertainty.assessment import soc_bands
from helpers.problems import drive_a
from helpers.reference import make_record
from helpers.report_reader import screen_of


@pytest.fixture(scope="module")
def result():
    """The bundled cell as it is identified without seeds: by the global optimum and tables."""
    return barnax.identify(seeds=0)


def test_the_answer_is_the_last_rung_that_was_kept(result):
    constant, answer = result.candidates
    assert (constant.is_answer, answer.is_answer) == (False, True)
    kept = [own for own in result.tried if own.kept]
    assert kept[-1].circuit == result.model == answer.model
    assert kept[-1].rmse_v == pytest.approx(result.fit.objective_v, rel=1e-6)
    # What is held out in blocks is what the fit says of itself.
    held = result.fit.cross_validation.tables
    assert held.rmse_v == pytest.approx(kept[-1].held_out.rmse_v, rel=1e-3)
    own = result.metrics.identification
    assert own.rmse_v == pytest.approx(answer.identification.rmse_v, rel=1e-12)
    # Tables of 17 nodes, which were the default, have 7.05 and 5.11 mV.
    assert 1e3 * own.rmse_v < 7.7
    assert 1e3 * result.metrics.validation[0].rmse_v < 5.3


def test_tables_are_level_beyond_the_nodes_next_to_samples(result):
    low_soc, high_soc = result.of_role("identification")[0].soc_range
    tables = result.fit.tables
    below = [soc for soc in tables.nodes if soc <= low_soc]
    above = [soc for soc in tables.nodes if soc >= high_soc]
    assert len(below) > 1
    for name in tables.tables:
        for ends, soc in ((below, low_soc), (above, high_soc)):
            at_ends = tables.at(name, np.array(ends))
            assert np.ptp(at_ends) == 0.0
            assert tables.at(name, np.array([soc]))[0] != at_ends[0]
    for node in result.fit.intervals:
        if node.name in tables.resistances and node.low is not None and node.high is not None:
            (value,) = tables.at(node.name, np.array([node.soc]))
            assert node.low <= value <= node.high
            assert node.value == pytest.approx(value, rel=1e-9)


def test_a_proved_constant_circuit_stands_beside_the_tables(result):
    constant = result.constant
    assert constant.model == result.candidates[0].model == "so-rc"
    assert constant.global_optimum.status == "certified"
    alone = result.without_tables()
    assert (alone.model, alone.tables, alone.metrics) == (constant.model, None, constant.metrics)


def test_the_first_screen_fits_a_terminal_and_nothing_is_to_be_mended(result):
    assert (result.warnings, result.notes) == ((), ())
    lines = [line.rstrip() for line in screen_of(first_screen(result), width=80).splitlines()]
    # With the command that is next and the list of files there are three more.
    assert len(lines) <= 21
    assert max(map(len, lines)) <= 80
    assert "…" not in "".join(lines)
    stored = Result.model_validate_json(result.to_json())
    assert stored.to_json() == result.to_json()
    assert stored.parameters["SOC"] == result.fit.tables.nodes
    assert len(stored.parameters["R0 [Ohm]"]) == len(stored.parameters["SOC"])


@pytest.mark.slow
def test_a_record_of_little_soc_gets_no_tables():
    result = barnax.identify(window=Window(score_to_s=1500.0), trust="none", seeds=0)
    assert result.tables is None
    assert {own.nodes for own in result.tried} == {1}
    assert isinstance(result.parameters["R0 [Ohm]"], float)


@pytest.fixture(scope="module")
def moving_cell(bundled_cell):
    """The bundled cell with four times its hysteresis."""
    wider = replace(
        bundled_cell.hysteresis,
        ends_v=tuple(tuple(4 * end for end in each) for each in bundled_cell.hysteresis.ends_v),
    )
    return replace(bundled_cell, hysteresis=wider)


@pytest.fixture(scope="module")
def moving_record(moving_cell):
    """A drive on it whose hysteresis follows the charge slowly."""
    time_s = np.arange(0.0, 8000.0, 2.0)
    current_a = drive_a(len(time_s), interval=25) / 3
    current_a[:100] = 0.0
    record = make_record(time_s, current_a, np.full(len(time_s), 3.7), name="moving.csv")
    window = Window(initial_soc=0.9, initial_direction=1)
    truth = CircuitParameters.of_tau(0.05, (0.01, 0.02), (10.0, 200.0), 40.0)
    made_v = simulate_circuit(prepare_record(record, moving_cell, "esc", window), truth)
    noise_v = 2e-4 * np.random.default_rng(0).standard_normal(len(time_s))
    return replace(record, voltage_v=made_v + noise_v), window


@pytest.mark.slow
def test_a_hysteresis_that_follows_the_charge_is_chosen_with_its_constants(
    moving_cell, moving_record
):
    record, window = moving_record
    free = barnax.identify(record, cell=moving_cell, window=window, seeds=0)
    assert (free.model, free.tables) == ("esc", None)
    assert free.parameters["R0 [Ohm]"] == pytest.approx(0.05, rel=0.002)
    assert free.parameters["gamma"] == pytest.approx(40.0, rel=0.02)


def test_the_set_up_of_the_paper_is_one_word():
    paper = Job(setup="li2023")
    assert (paper.model, paper.ocv_fit) == ("iso-rc", "polynomial")
    over = Job(setup="li2023", model="so-rc", ocv_fit="interpolated")
    assert (over.model, over.ocv_fit) == ("so-rc", "interpolated")
    with pytest.raises(barnax.InputError, match="`setup` 'li2024' is not known"):
        barnax.identify(setup="li2024")


@pytest.mark.slow
def test_asking_for_tables_takes_the_simpler_ones_too_unless_others_are_worth_it(result):
    asked = barnax.identify(over="soc", seeds=0, trust="none")
    assert (asked.model, asked.fit.tables.nodes) == (result.model, result.fit.tables.nodes)


@pytest.mark.slow
def test_what_is_held_is_held_in_every_circuit_that_has_it():
    few = {"window": Window(score_to_s=1500.0), "trust": "none", "seeds": 0}
    # Tables have no capacitance.
    farads = barnax.identify(fix={"C1 [F]": 1000.0}, **few)
    assert farads.constant.parameters.scales["C1 [F]"] == pytest.approx(1000.0)
    assert not any(each.over for each in farads.candidates)
    with pytest.raises(barnax.InputError, match="'gamma' is not a parameter of this circuit"):
        barnax.identify(model="so-rc", fix={"gamma": 50.0}, **few)


def test_a_sample_at_ten_percent_counts_above_it_in_held_out_errors_as_in_bands():
    error_v, soc = np.array([4.0, 2.0, 1.0]), np.array([0.05, 0.1, 0.15])
    (second,) = (band for band in soc_bands(soc, error_v) if band.low == 0.1)
    assert SocErrors.of([(error_v, soc)]).above_v == second.rmse_v == np.sqrt(2.5)
