"""An interval of a table that says nothing is "not determined", by hand-made ends."""

from types import SimpleNamespace
from typing import Any

import pytest

from barnax.cell.tables import HALF_HYSTERESIS, OCV_CORRECTION
from barnax.over_soc import NodeInterval, SocErrors
from barnax.reporting.soc_tables import constants_table, nodes_table, pay_sentence

OCV_V = (-0.01, 0.02)


def words(name: str, low: float | None, high: float | None) -> str:
    soc = None if name == "tau1 [s]" else 0.0
    each = NodeInterval(name, soc, 1.0, 0.0, 0.0, low, high)
    tables = SimpleNamespace(
        nodes=(0.0, 1.0),
        visited=(True, True),
        tables={} if soc is None else {name: OCV_V},
        constants={name: 1.0} if soc is None else {},
    )
    fit: Any = SimpleNamespace(tables=tables, intervals=(each,), of_table=lambda _: (each,))
    table = constants_table(fit) if soc is None else nodes_table(fit)
    return table.rows[0][-1]


@pytest.mark.parametrize(
    ("name", "low", "high", "told"),
    [
        ("R0 [Ohm]", 0.001, 0.1, "1 to 100"),
        ("R0 [Ohm]", 0.001, 0.101, "not determined"),
        ("R0 [Ohm]", 0.0, 0.01, "not determined"),
        ("R0 [Ohm]", None, None, "not determined"),
        ("tau1 [s]", 1.0, 99.0, "1 to 99"),
        ("tau1 [s]", 0.00327, 3.81e6, "not determined"),
        (OCV_CORRECTION, -0.01, 0.019, "-10 to 19"),
        (OCV_CORRECTION, -0.01, 0.021, "not determined"),
        (HALF_HYSTERESIS, 0.0, 0.01, "0 to 10"),
    ],
)
def test_an_interval_that_says_nothing_is_not_determined(name, low, high, told):
    assert words(name, low, high) == told


# Of the whole record and above 10 % SOC: the constant circuit, then tables.
NEARLY_EMPTY = SocErrors(0.0296, 0.0065), SocErrors(0.0297, 0.0049)
LOWER = SocErrors(0.0123, 0.0123), SocErrors(0.0073, 0.0073)
HIGHER = SocErrors(0.010, 0.008), SocErrors(0.012, 0.009)


@pytest.mark.parametrize(
    ("unseen", "held", "told"),
    [
        (NEARLY_EMPTY, None, "tables help above 10 % SOC: RMSE from 29.6 to 29.7 mV (6.5 to 4.9"),
        (LOWER, LOWER, "records, and from 12.3 to 7.3 mV"),
        (LOWER, HIGHER, "records, but from 10.0 to 12.0 mV"),
        (HIGHER, LOWER, "tables do not help: RMSE from 10.0 to 12.0 mV"),
    ],
)
def test_records_not_used_decide_whether_tables_pay(unseen, held, told):
    blocks = held and SimpleNamespace(constant=held[0], tables=held[1])
    fit: Any = SimpleNamespace(cross_validation=blocks)
    assert told in pay_sentence(fit, unseen)
