"""Parameters as frames, and results side by side."""

import re
from dataclasses import replace

import numpy as np
import pytest

import barnax
from barnax.fit.node_interval import NodeInterval
from barnax.reporting.wording import table
from barnax.uncertainty import Estimate, Uncertainty
from helpers.results import make_result, make_table_result, with_constant, with_fit


def with_intervals(r0_ohm, half_ohm, **given):
    """A constant circuit with an interval of R0 alone."""
    made = make_result("so-rc", **given)
    ends = {"low": r0_ohm - half_ohm, "high": r0_ohm + half_ohm}
    estimates = (
        Estimate("R0 [Ohm]", r0_ohm, relative_error=half_ohm / 2 / r0_ohm, **ends),
        Estimate("R1 [Ohm]", 0.0123, held="fixed"),
    )
    old = made.constant.assessment
    uncertainty = Uncertainty(0.95, 99, estimates, (), (), old.uncertainty.noise)
    circuit = made.circuit_parameters.with_tables({"R0 [Ohm]": [r0_ohm]})
    assessment = replace(old, uncertainty=uncertainty)
    return with_constant(made, assessment=assessment, parameters=circuit)


def test_the_intervals_of_constants_are_those_of_a_fit_of_one_node():
    fit = with_intervals(0.05, 0.002).fit
    (r0,) = fit.of_table("R0 [Ohm]")
    assert (r0.value, r0.low, r0.high) == (0.05, 0.05 - 0.002, 0.05 + 0.002)
    assert r0.standard_error == pytest.approx(0.001)
    assert [(node.low, node.high) for node in fit.of_table("R1 [Ohm]")] == [(None, None)]
    assert {fact.name for fact in fit.facts if fact.is_assessed} == {"R0 [Ohm]"}


@pytest.mark.parametrize(
    ("r0_ohm", "differing", "told"),
    [(0.0541, (), "+8.2 %, within"), (0.0543, ("R0",), "+8.6 %, beyond")],
)
def test_what_differs_is_what_no_interval_of_the_other_reaches(r0_ohm, differing, told):
    results = with_intervals(0.05, 0.002), with_intervals(r0_ohm, 0.0022)
    beside = barnax.show(*results, names=("fresh", "aged"))
    assert beside.differing == {"aged": differing}
    assert told in repr(beside)
    assert told in beside._repr_html_()
    assert "no interval" in repr(beside)


def moved(result, is_moved, **by):
    """The result with some intervals changed: their ends, or values, as `by` says of each."""

    def changed(each):
        return replace(each, **{end: change(getattr(each, end)) for end, change in by.items()})

    own = (changed(each) if is_moved(each) else each for each in result.fit.intervals)
    return with_fit(result, intervals=tuple(own))


def test_tables_are_compared_at_states_of_charge_between_visited_nodes():
    one, tables = make_table_result(), make_table_result().fit.tables
    raised = with_fit(one, tables=tables.with_tables({"R0 [Ohm]": tables.ohm[0] + 0.005}))
    ends = dict.fromkeys(("value", "low", "high"), lambda ohm: ohm + 0.005)
    raised = moved(raised, lambda each: each.name == "R0 [Ohm]", **ends)
    beside = barnax.show(one, raised)
    places = tuple(f"R0 at {soc} % SOC" for soc in (10, 30, 50, 70, 90))
    assert beside.differing == {"2: cycle.csv": places}
    # One node that no sample tells: its value is an accident, and nothing is compared there.
    opened = dict.fromkeys(("low", "high"), lambda _: None) | {"value": lambda ohm: 3 * ohm}
    without = moved(raised, lambda each: (each.name, each.soc) == ("R0 [Ohm]", 0.5), **opened)
    beside = barnax.show(one, without)
    assert "R0 at 50 % SOC" not in beside.differing["2: cycle.csv"]
    assert "not determined" in repr(beside)
    # Tables and a constant circuit have only the latter in common.
    constants = repr(barnax.show(one, make_result("so-rc", record="b.csv")))
    assert "Constant circuits" in constants
    assert "b.csv has no tables over SOC, so the constant circuits are compared." in constants


def test_an_interval_that_would_hide_a_doubling_is_too_wide_to_tell():
    results = with_intervals(0.05, 0.002), with_intervals(0.07, 0.025)
    beside = barnax.show(*results, names=("fresh", "aged"))
    assert beside.differing == {"aged": ()}
    assert beside.too_wide == {"aged": ("R0",)}
    assert "nothing differs from fresh beyond the intervals; for R0 they are too wide to tell." in (
        " ".join(repr(beside).split())
    )
    assert "+40 %, too wide to tell" in repr(beside)


def visiting(result, is_visited, **changes):
    """The result whose samples are near some nodes only."""
    tables = result.fit.tables
    visited = tuple(is_visited(node) for node in tables.nodes)
    return with_fit(result, tables=replace(tables, visited=visited), **changes)


def test_means_are_compared_over_the_soc_that_all_results_visit():
    one, alike = make_table_result(), make_table_result()
    fit, fine = one.fit, np.linspace(0.5, 1, 100_001)
    name, *_ = names = [mean.name for mean in fit.means]
    of_top_ohm = {name: float(np.mean(fit.tables.at(name, fine))) for name in names}
    means = tuple(
        replace(mean, value=of_top_ohm[mean.name], low=0.9 * mean.value, high=1.1 * mean.value)
        for mean in fit.means
    )
    top = visiting(one, lambda node: node >= 0.5, means=means)
    beside = barnax.show(one, alike, top, names=("one", "alike", "top"))
    assert not any(title.startswith("mean") for title in beside.differing["top"])
    text = " ".join(repr(beside).split())
    rows = [line.split() for line in repr(beside).split("\n") if line.split()[:2] == ["mean", "R0"]]
    assert [row[2] for row in rows] == ["50-100"]
    # Over its whole range the mean of the first is another, and would differ by that.
    assert f"{1e3 * of_top_ohm[name]:.3g} mOhm" in text
    assert f"{1e3 * fit.means[0].value:.3g}" != f"{1e3 * of_top_ohm[name]:.3g}"
    assert "The means are over 50-100 % SOC, which all results visit." in text
    assert "all results visit" not in repr(barnax.show(one, alike))
    bottom = visiting(one, lambda node: node < 0.5)
    apart = " ".join(repr(barnax.show(top, bottom, names=("top", "bottom"))).split())
    assert "and are not compared" in apart


def test_a_mean_over_most_of_its_soc_has_an_interval_about_as_narrow():
    one = make_table_result()
    # The means are known to 1 %, each node by itself to 20 % only.
    means = tuple(
        replace(mean, low=0.99 * mean.value, high=1.01 * mean.value) for mean in one.fit.means
    )
    nodes = tuple(
        each if each.soc is None else replace(each, low=0.8 * each.value, high=1.2 * each.value)
        for each in one.fit.intervals
    )
    one = with_fit(one, means=means, intervals=nodes)
    first = min(node for node in one.fit.tables.nodes if node > 0.1)
    other = visiting(one, lambda node: node >= first)
    (row,) = (line for line in repr(barnax.show(one, other)).split("\n") if "mean R0" in line)
    shown = re.search(r"([\d.]+) mOhm \(([\d.]+) to ([\d.]+)\)", row)
    value, low, high = map(float, shown.groups())
    assert 0.95 * value < low < 0.985 * value
    assert 1.015 * value < high < 1.05 * value


def test_a_mean_that_is_known_from_one_side_stays_so_over_part_of_its_soc():
    one = make_table_result()
    means = tuple(replace(mean, low=None, high=2 * mean.value) for mean in one.fit.means)
    nodes = tuple(each.as_undetermined() for each in one.fit.intervals)
    one = with_fit(one, means=means, intervals=nodes)
    other = visiting(make_table_result(), lambda node: node >= 0.2)
    lines = repr(barnax.show(one, other)).split("\n")
    assert "(at most " in next(line for line in lines if "mean R0    20-100 %" in line)


def test_a_parameter_at_its_lower_bound_has_its_upper_limit_in_the_table():
    made = with_intervals(0.05, 0.002)
    assessment = made.constant.assessment
    at_bound = Estimate("R1 [Ohm]", 1e-4, held="at lower bound", high=0.021)
    estimates = (*assessment.uncertainty.estimates[:1], at_bound)
    uncertainty = replace(assessment.uncertainty, estimates=estimates)
    made = with_constant(made, assessment=replace(assessment, uncertainty=uncertainty))
    rows = {row[0]: row[2] for row in table("result.parameters", made.constant).rows}
    assert rows == {"R0 [mOhm]": "48 to 52", "R1 [mOhm]": "at most 21"}


def test_between_nodes_of_which_one_has_an_upper_limit_alone_there_is_one():
    first = NodeInterval("R1 [Ohm]", 0.2, 0.0, 0.0, 0.0, None, 0.01)
    last = NodeInterval("R1 [Ohm]", 0.4, 0.02, 1e-3, 0.0, 0.018, 0.022)
    line = first.between(last, 0.3)
    assert (line.value, line.high) == (pytest.approx(0.01), pytest.approx(0.016))
    assert line.low is None
    opened = first.as_undetermined().between(last, 0.3)
    assert (opened.low, opened.high) == (None, None)
