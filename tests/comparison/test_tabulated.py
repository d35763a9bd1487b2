"""Tables over SOC beside the constant circuits of a comparison."""

import pytest

from barnax.baselines import Budget
from barnax.bundled import BUNDLED
from barnax.comparison import ComparisonResult, compare, make_comparison_result
from barnax.comparison.tabulated import tabulate
from barnax.errors import InputError
from barnax.metrics import measure
from barnax.model.window import Window
from barnax.over_soc import TableSettings, simulate_tables
from barnax.records import read_record
from barnax.reporting.comparison import comparison_document
from barnax.reporting.render import to_markdown

SMALL = TableSettings(nodes=(0.5, 0.9, 1.0), most_cells=0, block_s=100.0)
HELD = {"tau1 [s]": 10.0}


@pytest.fixture(scope="module")
def comparison(bundled_record, bundled_cell):
    return compare(
        bundled_record,
        bundled_cell,
        (("so-rc", "ls"), ("so-rc", "lm")),
        validation=[read_record(BUNDLED.validation)],
        window=Window(score_to_s=1500.5),
        budget=Budget(population=8, iterations=5, seeds=2),
        fixed=HELD,
    )


@pytest.fixture(scope="module")
def found(comparison):
    return tabulate(comparison, ["so-rc"], SMALL, fixed=HELD)[0]


def test_fixed_values_hold_for_tables_too(found):
    assert found.fit.tables.tau_s[0] == pytest.approx(10.0)
    assert found.searches[0].constants["tau1 [s]"] == pytest.approx(10.0)


def test_only_methods_that_search_have_a_row(found):
    assert [each.method for each in found.searches] == ["lm"]
    assert found.searches[0].gap == pytest.approx(0.0, abs=1e-4)
    assert found.searches[0].seeds == 2


def test_errors_are_those_of_a_simulation_of_every_record(found, comparison):
    for evaluation, own, searched in zip(
        comparison.answered[-1].evaluations, found.errors, found.searches[0].errors, strict=True
    ):
        prepared = evaluation.prepared
        simulated_v = simulate_tables(prepared, found.fit.tables)
        expected = measure(prepared.voltage_v[prepared.scored], simulated_v[prepared.scored]).rmse_v
        assert own.rmse_v == pytest.approx(expected, rel=1e-12)
        assert searched.rmse_v == pytest.approx(expected, rel=1e-2)


def test_samples_beyond_what_was_identified_are_a_warning(found):
    assert any("outside the SOC that the tables were identified on" in w for w in found.warnings)


def test_stored_and_told(found, comparison, tmp_path):
    result = make_comparison_result(comparison, [found])
    path = tmp_path / "comparison.json"
    path.write_text(result.to_json())
    assert ComparisonResult.from_json(path) == result
    text = to_markdown(comparison_document(result))
    assert "lm so-rc:soc" in text
    assert "on the validation records" in text


def test_a_model_without_an_answer_is_refused(comparison):
    with pytest.raises(InputError, match="no row of esc"):
        tabulate(comparison, ["esc"], SMALL)


def test_what_tables_do_not_have_cannot_be_held(comparison):
    with pytest.raises(InputError, match="cannot be bounded or fixed"):
        tabulate(comparison, ["so-rc"], SMALL, fixed={"C1 [F]": 500.0})
