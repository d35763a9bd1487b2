"""Reduced records against every sample's columns, solved by SciPy."""

import tracemalloc
from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import lsq_linear

from barnax.cell.parameters import OCV_CORRECTION
from barnax.errors import InputError
from barnax.execution import in_float64
from barnax.fit.intervals import jacobian_blocks
from barnax.fit.settings import TableSettings
from barnax.fit.table_fit import fit_tables
from barnax.fit.table_problem import find_best, polish, reduced_objective, search_ranges
from barnax.model import prepared as preparing
from barnax.model import reduced, reference
from barnax.model.prepared import Window, prepare_record
from barnax.model.reference import simulate_circuit

from .conftest import BOX, NODES, SMALL


def objective_of(prepared, settings=SMALL, gamma_range=None):
    ranges = BOX if gamma_range is None else BOX | {"gamma": gamma_range}
    return reduced_objective([prepared], settings, ranges)


@in_float64
def whole(objective, place):
    """Every sample's columns and the penalty's rows, and the target, for SciPy."""
    actual = objective.solve(place)
    columns, base, _ = map(np.concatenate, zip(*jacobian_blocks(objective, actual), strict=True))
    base, unknowns = base[:, 0], len(actual.unknowns)
    matrix = np.concatenate([columns[:, :unknowns] / np.sqrt(len(base)), objective.table_penalty])
    # An OCV correction that may fall by so much only is the sum of its steps.
    steps = np.eye(unknowns)
    if objective.settings.rising_ocv:
        correction = slice(3 * len(NODES), 4 * len(NODES))
        steps[correction, correction] = np.tri(len(NODES))
    target = np.append(base / np.sqrt(len(base)), np.zeros(len(matrix) - len(base)))
    return matrix, target, steps


def objective_and_scales(prepared, **changes):
    """What all three kinds of hysteresis are tested at."""
    place, settings = np.log([10.0, 100.0, 40.0]), replace(SMALL, **changes)
    if prepared.circuit == "esc":
        return objective_of(prepared, settings, (5.0, 500.0)), tuple(place)
    return objective_of(prepared, settings), tuple(place[:2])


@pytest.fixture
def falling(prepared):
    """A record whose voltage asks for an OCV that falls with SOC."""
    return replace(prepared, source_v=prepared.source_v + 3 * prepared.soc)


@pytest.mark.parametrize(
    ("name", "amplitude"),
    [
        ("prepared", False),
        ("with_hysteresis", False),
        ("with_hysteresis", True),
        ("falling", False),
    ],
)
def test_scipy_finds_the_same_tables_on_all_samples(name, amplitude, request):
    prepared = request.getfixturevalue(name)
    objective, log_scales = objective_and_scales(prepared, half_hysteresis=amplitude)
    actual = objective.solve(log_scales, exact=True)
    matrix, target, steps = whole(objective, log_scales)
    other = lsq_linear(matrix @ steps, -target, objective.box, method="bvls", tol=1e-14)
    assert actual.rms_v == pytest.approx(np.sqrt(2 * other.cost), rel=1e-9)
    assert np.concatenate(actual.values) == pytest.approx(steps @ other.x, rel=1e-6, abs=1e-8)
    # The scan of these tables has the error that the factor says.
    tables = objective.tables_at(actual)
    error_v = (prepared.voltage_v - simulate_circuit(prepared, tables))[prepared.scored]
    assert np.sqrt(np.mean(error_v**2)) == pytest.approx(np.linalg.norm(actual.error), rel=1e-9)


def test_a_corrected_ocv_rises_between_all_nodes_unless_it_is_left_free(falling):
    held = replace(SMALL, bounds={}, fixed={"tau1 [s]": 10.0, "tau2 [s]": 100.0})
    rising, free = (fit_tables([falling], replace(held, rising_ocv=each)) for each in (True, False))
    soc = np.linspace(NODES[0], NODES[-1], 701)
    known_v = falling.cell.average_ocv_v(soc)
    ocv_v, free_v = (known_v + each.tables.at(OCV_CORRECTION, soc) for each in (rising, free))
    assert np.all(np.diff(ocv_v) > -1e-7)
    assert np.any(np.diff(free_v) < -1e-4)
    assert rising.objective_v > free.objective_v
    # Nodes that the bounds tie together move as one, so one is as uncertain as the next.
    reach = [each.standard_error for each in rising.of_table(OCV_CORRECTION)]
    assert reach[1:] == pytest.approx([reach[0]] * (len(reach) - 1))
    assert reach[0] > 0


def test_r0_has_a_floor_by_the_current_steps_where_samples_would_have_none(prepared):
    fixed = {"tau1 [s]": 10.0, "tau2 [s]": 100.0, **dict.fromkeys(("R1 [Ohm]", "R2 [Ohm]"), 0.0)}
    source_v = prepared.source_v - 0.4 * prepared.current_a * (prepared.soc < 0.9)
    inverted = replace(prepared, source_v=source_v)
    settings = replace(SMALL, bounds={}, fixed=fixed)
    fit = fit_tables([inverted], settings)
    floor_ohm = prepared.record.resistance_ohm / 3
    (told,) = [each for each in fit.warnings if each.code == "tables.r0-at-floor"]
    table, seen = dict(zip(NODES, fit.tables.ohm[0], strict=True)), fit.tables.visited
    assert min(table.values()) == floor_ohm
    visited = (node for node, is_near in zip(NODES, seen, strict=True) if is_near)
    held = [node for node in visited if table[node] == floor_ohm]
    assert told.values["percent"] == ", ".join(f"{100 * node:g}" for node in held)
    assert held
    assert 1.0 not in held
    low = {each.soc: each.low for each in fit.of_table("R0 [Ohm]")}
    assert [low[node] for node in held] == [None] * len(held)
    # What is asked for is done, and told where it is nothing.
    free = replace(settings, bounds={"R0 [Ohm]": (0.0, 1.0)})
    bare = fit_tables([inverted], free).warnings
    assert [each.values["soc"] for each in bare if each.code == "tables.no-resistance"] == held
    assert "tables.no-r0" not in {notice.code for notice in bare}
    nowhere = replace(prepared, source_v=prepared.source_v - 0.4 * prepared.current_a)
    assert "tables.no-r0" in {notice.code for notice in fit_tables([nowhere], free).warnings}


@pytest.mark.parametrize("name", ["prepared", "with_hysteresis"])
def test_many_blocks_are_one_scan_over_all_samples(name, request, monkeypatch):
    prepared = request.getfixturevalue(name)
    assert 4 * 512 < len(prepared.soc) < preparing.BLOCK
    for module in (preparing, reduced, reference):
        monkeypatch.setattr(module, "BLOCK", 512)
    objective, log_scales = objective_and_scales(prepared)
    actual = objective.solve(log_scales, exact=True)
    tables = objective.tables_at(actual)
    simulated_v = simulate_circuit(prepared, tables)
    monkeypatch.undo()
    assert simulated_v == pytest.approx(simulate_circuit(prepared, tables), rel=1e-12, abs=1e-13)
    error_v = (prepared.voltage_v - simulated_v)[prepared.scored]
    assert np.linalg.norm(actual.error) == pytest.approx(np.sqrt(np.mean(error_v**2)), rel=1e-10)


def test_a_longer_record_holds_no_more_than_a_few_of_its_arrays(bundled_record, bundled_cell):
    def most_bytes(times):
        """What is held at most beyond the record, sampled so many times as fast."""
        at = np.repeat(np.arange(bundled_record.samples), times)
        arrays = {name: getattr(bundled_record, name)[at] for name in ("current_a", "voltage_v")}
        time_s = bundled_record.time_s[0] + np.arange(len(at)) / times
        plain = {"temperature_degc": None, "step": None, "row": np.arange(len(at))}
        record = replace(bundled_record, time_s=time_s, **arrays, **plain)
        prepared = prepare_record(record, bundled_cell, "so-rc", Window(score_to_s=9000.5))
        # Compiling takes memory too, and so do the annotations that tests check, now and then.
        fit_tables([prepared.part(slice(0, 5000))], settings)
        tried = []
        for _ in range(2):
            tracemalloc.start()
            fit_tables([prepared], settings)
            tried.append(tracemalloc.get_traced_memory()[1])
            tracemalloc.stop()
        return min(tried), len(prepared.soc)

    held = {"tau1 [s]": 20.0, "tau2 [s]": 80.0}
    settings = replace(SMALL, nodes=(0.31, 1.0), bounds={}, fixed=held)
    (short, few), (long, many) = most_bytes(1), most_bytes(3)
    assert (long - short) / (many - few) < 24


def test_the_normal_equations_are_accurate_enough_to_search_with(prepared):
    objective = objective_of(prepared)
    for taus in ((6.0, 50.0), (15.0, 180.0)):
        place = tuple(np.log(taus))
        rough, exact = objective.solve(place), objective.solve(place, exact=True)
        assert rough.rms_v == pytest.approx(exact.rms_v, rel=1e-11)


def test_descents_from_all_over_the_box_find_nothing_better(prepared):
    objective = objective_of(prepared)
    best = find_best(objective)
    for taus in ((5.5, 45.0), (19.0, 50.0), (6.0, 190.0), (18.0, 180.0)):
        end = polish(objective, objective.solve(tuple(np.log(taus))))
        assert best.objective_v2 <= end.objective_v2 * (1 + 1e-9)


def test_bounds_and_held_values_are_kept(prepared):
    fixed = {"tau1 [s]": 10.0, "tau2 [s]": 80.0, "R1 [Ohm]": 0.01}
    settings = replace(SMALL, bounds={"R0 [Ohm]": (0.05, 0.055)}, fixed=fixed)
    fit = fit_tables([prepared], settings)
    assert min(fit.tables.ohm[0]) >= 0.05
    assert max(fit.tables.ohm[0]) <= 0.055
    assert set(fit.tables.ohm[1]) == {0.01}
    assert fit.tables.tau_s == pytest.approx((10.0, 80.0))
    assert fit.at_bound == ()


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        # What the circuit does not have.
        ({"fixed": {"gamma": 10.0}}, "gamma"),
        ({"bounds": {"tau3 [s]": (1.0, 2.0)}}, "tau3"),
        ({"half_hysteresis": True}, "esc"),
        # What no circuit can have.
        ({"nodes": (0.5, 0.4)}, "nodes"),
        ({"roughness": 0.0}, "roughness"),
        ({"folds": 1}, "folds"),
        ({"bounds": {"C1 [F]": (1.0, 2.0)}}, "C1"),
        ({"bounds": {"tau1 [s]": (2.0, 1.0)}}, "tau1"),
        ({"bounds": {"tau1 [s]": (1.0, 2.0)}, "fixed": {"tau1 [s]": 1.0}}, "tau1"),
    ],
)
def test_settings_that_cannot_be_are_refused_by_name(prepared, settings, words):
    with pytest.raises(InputError, match=words):
        fit_tables([prepared], TableSettings(**settings))


def test_a_record_of_seconds_has_tables_and_nothing_held_out(bundled_record, bundled_cell):
    window = Window(score_to_s=20.5)
    short = prepare_record(bundled_record, bundled_cell, "so-rc", window)
    fit = fit_tables([short])
    assert fit.cross_validation is None
    assert fit.tables.tau_s == pytest.approx((2.0, 2.0))
    assert [each.code for each in fit.warnings] == ["tables.mostly-unvisited"]


def held_or_fitted(fit):
    """What the warnings of a fit to records that go one way are about."""
    told = (each for each in fit.warnings if each.code == "tables.one-direction")
    return ["gamma" if "gamma" in each.values else "amplitude" for each in told]


def test_hysteresis_is_held_where_records_go_one_way_only(with_hysteresis):
    held = {"tau1 [s]": 10.0, "tau2 [s]": 60.0}
    settings = replace(SMALL, bounds={}, fixed=held)
    fit = fit_tables([with_hysteresis], settings)
    assert fit.tables.gamma == pytest.approx(20.0)
    assert held_or_fitted(fit) == ["gamma"]
    # Asked for, it is searched, and its amplitude is fitted with a warning.
    fit = fit_tables([with_hysteresis], replace(settings, bounds={"gamma": (5.0, 50.0)}))
    assert "gamma" not in held_or_fitted(fit)
    fit = fit_tables([with_hysteresis], replace(settings, half_hysteresis=True))
    assert held_or_fitted(fit) == ["amplitude"]


def test_time_constants_far_below_the_sampling_interval_are_not_searched(prepared):
    coarse = replace(prepared, record=replace(prepared.record, time_s=60 * prepared.record.time_s))
    assert set(search_ranges([coarse], TableSettings()).values()) == {(30.0, 1000.0)}
    assert search_ranges([prepared], TableSettings())["tau1 [s]"][0] == 2.0


def test_intervals_are_of_visited_nodes_and_hold_their_values(prepared):
    fit = fit_tables([prepared], SMALL)
    nodes = [node for node, visited in zip(NODES, fit.tables.visited, strict=True) if visited]
    assert 0 < len(nodes) < len(NODES)
    for name, table in fit.tables.tables.items():
        assert [each.soc for each in fit.of_table(name)] == nodes
        for each in fit.of_table(name):
            assert each.value == table[NODES.index(each.soc)]
            assert each.low is None or each.high is None or each.low <= each.value <= each.high
    assert [each.name for each in fit.intervals[-2:]] == ["tau1 [s]", "tau2 [s]"]
    assert fit.parameters == 4 * len(nodes) + 2
