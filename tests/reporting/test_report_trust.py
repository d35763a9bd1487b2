"""How far to trust the answer, as a report says it."""

import jax
import pytest

from barnax.reporting import identification_document
from barnax.reporting.document import Bullets, Table
from barnax.reporting.identification import trust_section
from barnax.results import make_result
from barnax.search.evaluate import evaluate
from barnax.uncertainty import assess, examine


@pytest.fixture(scope="module")
def result(checked):
    identified = evaluate(checked.search.problem.prepared, checked.parameters)
    assessment = assess(checked)
    examination = examine(checked, assessment, key=jax.random.key(0))
    return make_result(checked, [identified], assessment=assessment, examination=examination)


def test_it_stands_after_the_parameters(result):
    titles = [section.title for section in identification_document(result).sections]
    assert titles[titles.index("Parameters") + 1] == "How far to trust this"


def test_it_says_what_the_data_leave_open_and_shows_both_errors(result):
    (section,) = trust_section(result)
    told = section.blocks[0]
    assert isinstance(told, Bullets)
    assert result.trust.uncertainty.words in told.items
    for finding in result.trust.identifiability.findings:
        assert finding.text in told.items
    assert result.trust.examination.words in told.items
    table = section.blocks[1]
    assert isinstance(table, Table)
    stored = result.trust.uncertainty.parameters
    assert [row[0] for row in table.rows] == [name.replace("[Ohm]", "[mOhm]") for name in stored]
    first = stored["R0 [Ohm]"]
    assert table.rows[0][2] == f"{1e3 * first.low:.4g}"
    assert table.rows[0][6] == f"{first.inflation:.1f}"


def test_every_band_has_its_row(result):
    (section,) = trust_section(result)
    bands = section.blocks[-1]
    found = result.trust.diagnostics
    assert isinstance(bands, Table)
    assert len(bands.rows) == len(found.by_soc) + len(found.by_current)


def test_a_result_that_was_not_assessed_has_no_such_section(checked):
    identified = evaluate(checked.search.problem.prepared, checked.parameters)
    assert trust_section(make_result(checked, [identified])) == []
