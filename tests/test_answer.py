"""The answer of the bundled cell and of simulated ones: what was chosen, and what stands beside."""

import io

import numpy as np
import pytest
from rich.console import Console

import barnax
from barnax.cli.session import as_flags
from barnax.job import Job
from barnax.over_soc import SocErrors
from barnax.reporting.first_screen import first_screen
from barnax.results import Result
from barnax.uncertainty.assessment import soc_bands


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


def test_a_proved_constant_circuit_stands_beside_the_tables(result):
    constant = result.constant
    assert constant.model == result.candidates[0].model == "so-rc"
    assert constant.global_optimum.status == "certified"
    alone = result.without_tables()
    assert (alone.model, alone.tables, alone.metrics) == (constant.model, None, constant.metrics)


def test_the_first_screen_fits_a_terminal_and_nothing_is_to_be_mended(result):
    assert (result.warnings, result.notes) == ((), ())
    console = Console(file=io.StringIO(), width=80, highlight=False)
    for block in first_screen(result, as_flags):
        console.print(block)
    lines = [line.rstrip() for line in console.file.getvalue().splitlines()]
    # With the command that is next and the list of files there are three more.
    assert len(lines) <= 21
    assert max(map(len, lines)) <= 80
    text = "\n".join(lines)
    assert f"tables over SOC ({result.model})" in text
    assert "<- answer" in text
    assert "…" not in text
    assert text.count("Assumed:") == 1


def test_what_is_stored_says_the_same(result, tmp_path):
    path = tmp_path / "result.json"
    path.write_text(result.to_json())
    stored = Result.from_json(path)
    assert stored.to_json() == result.to_json()
    assert stored.parameters["SOC"] == result.fit.tables.nodes
    assert len(stored.parameters["R0 [Ohm]"]) == len(stored.parameters["SOC"])


def test_the_set_up_of_the_paper_is_one_word():
    paper = Job(setup="li2023")
    assert (paper.model, paper.ocv_fit) == ("iso-rc", "polynomial")
    over = Job(setup="li2023", model="so-rc", ocv_fit="interpolated")
    assert (over.model, over.ocv_fit) == ("so-rc", "interpolated")
    with pytest.raises(barnax.InputError, match="`setup` 'li2024' is not known"):
        barnax.identify(setup="li2024")


def test_a_sample_at_ten_percent_counts_above_it_in_held_out_errors_as_in_bands():
    error_v, soc = np.array([4.0, 2.0, 1.0]), np.array([0.05, 0.1, 0.15])
    (second,) = (band for band in soc_bands(soc, error_v) if band.low == 0.1)
    assert SocErrors.of([(error_v, soc)]).above_v == second.rmse_v == np.sqrt(2.5)
