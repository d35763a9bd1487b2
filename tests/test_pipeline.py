"""`barnax.identify`: the answer is the best circuit known, whatever it was found from."""

import math
from dataclasses import replace

import numpy as np
import polars as pl
import pytest

import barnax
from barnax import InputError, Notice, Result, Window
from barnax.bundled import BUNDLED
from barnax.identification import answer
from helpers import made_cell
from helpers.problems import simulated_record

SHORT = Window(score_to_s=1500.0)
# The search that tests of the command compile too.
SMALL = {"setup": "li2023", "seeds": 1, "population": 8, "iterations": 5, "trust": "none"}
OCV = list(BUNDLED.ocv)


@pytest.fixture(scope="module")
def few():
    """One short seed on the bundled cell."""
    return barnax.identify(window=SHORT, **SMALL)


def test_no_answer_lies_above_the_proved_optimum(few):
    optimum = few.constant.global_optimum
    assert optimum.status == "certified"
    assert few.metrics.identification.rmse_v <= optimum.rmse_v * (1 + 1e-9)
    assert few.constant.refined.rmse_v >= optimum.lower_bound_v


@pytest.mark.slow
def test_bounds_of_almost_nothing_are_searched_by_the_scan_and_lose_nothing():
    bounds = {"tau1 [s]": (1e-6, 1e9), "R1 [Ohm]": (1e-9, 0.2)}
    result = barnax.identify(window=SHORT, bounds=bounds, **(SMALL | {"trust": "basic"}))
    assert result.constant.search.objective == "scan"
    assert math.isfinite(result.metrics.identification.rmse_v)
    # The optimum is not looked for: the answer is that of the seeds.
    assert (result.constant.global_optimum, result.constant.source) == (None, "seeds")
    assert result.parameters == result.constant.refined.parameters.to_dict()
    assert "unknown: the bounds" in result._repr_html_()
    assert result.to_json()


def test_the_same_samples_are_refused_in_any_bytes_and_warned_of_for_a_stored_result(few, tmp_path):
    copy, part = tmp_path / "copy.parquet", tmp_path / "part.csv"
    copy.write_bytes(BUNDLED.record.read_bytes())
    with pytest.raises(InputError, match=r"identification\.parquet: the same as copy\.parquet, by"):
        barnax.identify(copy, ocv=OCV, validate=BUNDLED.record)
    in_ma = (1e3 * pl.col("Current / A")).round(1).alias("Current / mA")
    pl.read_parquet(BUNDLED.record)[:15_000].with_columns(in_ma).drop("Current / A").write_csv(part)
    with pytest.raises(InputError, match=r"part\.csv: of the same samples as iden"):
        barnax.identify(BUNDLED.record, ocv=OCV, validate=part)
    (notice,) = [each for each in few.validate(part).warnings if each.code == "role.same-record"]
    assert (notice.subject, notice.values["other"]) == ("part.csv", "identification.parquet")


@pytest.mark.parametrize("failure", [ArithmeticError("math domain error"), np.linalg.LinAlgError()])
def test_a_failed_assessment_costs_only_itself(few, monkeypatch, failure):
    def fails(*_, **__):
        raise failure

    monkeypatch.setattr(answer, "assess", fails)
    result = barnax.identify(window=SHORT, **(SMALL | {"trust": "full"}))
    assert result.parameters == few.parameters
    assert result.constant.assessment is None
    incomplete = {"part": "the intervals", "reason": str(failure) or "LinAlgError"}
    assert Notice("answer.incomplete", incomplete) in result.warnings
    assert Result.model_validate_json(result.to_json()).to_json() == result.to_json()


@pytest.mark.parametrize("name", ["find_global_optimum", "compile_linearization", "Descent"])
def test_a_failure_beside_the_search_is_not_swallowed(monkeypatch, name):
    def fails(*_, **__):
        raise RuntimeError("beside the search")

    monkeypatch.setattr(answer, name, fails)
    with pytest.raises(RuntimeError, match="beside the search"):
        barnax.identify(window=SHORT, **(SMALL | {"trust": "basic"}))


def test_a_parameter_at_its_bound_is_a_warning_of_the_result():
    result = barnax.identify(window=SHORT, bounds={"R0 [Ohm]": (0.06, 0.2)}, **SMALL)
    assert ("R0 [Ohm]", "lower") in {(each.name, each.side) for each in result.constant.at_bound}
    assert Notice("answer.at-bound", {"name": "R0 [Ohm]", "side": "lower"}) in result.warnings


def test_every_input_is_checked_and_every_warning_names_its_file(tmp_path):
    """A finding of `check` on an OCV test or a validation record is a warning of the result."""
    for path in (BUNDLED.validation, *OCV):
        table = pl.read_parquet(path)
        pl.concat([table.head(40), table[39:]]).write_parquet(tmp_path / path.name)
    validation, *ocv = (tmp_path / path.name for path in (BUNDLED.validation, *OCV))
    given = {"ocv": ocv, "validate": validation, "window": SHORT}
    result = barnax.identify(BUNDLED.record, **given, **SMALL)
    for path in (BUNDLED.validation, *OCV):
        assert (path.name, 42) in {(each.subject, each.row) for each in result.notes}


def test_a_figure_is_drawn_by_its_name_and_a_stored_result_says_it_has_no_run(few, tmp_path):
    assert few.figure("voltage").axes
    with pytest.raises(InputError, match="there is no figure 'volts'; there are "):
        few.figure("volts")
    (tmp_path / "result.json").write_text(few.to_json())
    stored = Result.from_json(tmp_path / "result.json")
    assert stored.to_json() == few.to_json()
    with pytest.raises(InputError, match=r"without its records; `Result\.load`"):
        stored.figure("voltage")


def test_a_notebook_shows_names_as_names(few):
    assert "Best possible" in few._repr_html_()
    hostile = few.inputs[0].model_copy(update={"name": "<script>alert(1)</script>.csv"})
    identified = replace(few.metrics.identification, record=hostile.name)
    metrics = few.metrics.model_copy(update={"identification": identified})
    shown = few.model_copy(update={"inputs": (hostile, *few.inputs[1:]), "metrics": metrics})
    assert "<script>" not in shown._repr_html_()
    assert "&lt;script&gt;" in shown._repr_html_()


R0_OHM, R_OHM, TAU_S = 0.050, (0.020, 0.015), (30.0, 400.0)


@pytest.fixture(scope="module")
def cut_record(bundled_cell):
    """A record that begins at rest in the middle of a discharge, with half a millivolt of noise."""
    time_s = np.arange(0.0, 4000.0, 2.0)
    levels = np.random.default_rng(0).choice([0.0, 0.5, 1.0, 2.0, -1.0], size=len(time_s) // 50)
    levels[:8] = 0.0
    # The discharge branch as it was fitted is there where the hysteresis puts it.
    given = {"circuit": (R0_OHM, R_OHM, TAU_S), "noise_v": 5e-4, "name": "cut.csv"}
    return simulated_record(bundled_cell, time_s, np.repeat(levels, 50), 0.592, -1.0, **given)


def test_an_open_direction_is_tried_both_ways_and_reported(cut_record):
    result = barnax.identify(cut_record, ocv=OCV, **SMALL | {"seeds": 0})
    assert (result.start.direction, result.start.direction_source) == (-1, "better fit")
    assert result.start.other_rmse_v > 2 * result.metrics.identification.rmse_v
    actual = result.constant.parameters
    assert actual.r0 == pytest.approx(R0_OHM, rel=0.02)
    assert actual.r == pytest.approx(R_OHM, rel=0.02)
    assert "the cell was last discharged before cut.csv" in result._repr_html_()
    assert result.metrics.identification.rmse_v == pytest.approx(5e-4, rel=0.1)


@pytest.mark.slow
def test_a_fast_record_without_an_ocv_test_shows_its_third_pair(monkeypatch):
    monkeypatch.setattr(made_cell, "R_OHM", (0.01, 0.02, 0.03))
    monkeypatch.setattr(made_cell, "TAU_S", (1.5, 12.0, 100.0))
    fast, _ = made_cell.made(hours=0.4, scale=6.0, noise_v=1e-4)
    actual = barnax.identify(fast, seeds=0, trust="none", max_boxes=0)
    assert actual.model == "3rc"
    taus_s = [actual.fit.tables.constants[f"tau{pair} [s]"] for pair in (1, 2, 3)]
    assert np.allclose(taus_s, (1.5, 12.0, 100.0), rtol=0.1)
