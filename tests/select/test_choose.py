"""The family and its choice on cells of known structure."""

from dataclasses import replace
from itertools import product
from types import SimpleNamespace

import numpy as np
import pytest

from barnax import TableSettings, Window
from barnax.cell.parameters import ANYWHERE
from barnax.errors import InputError
from barnax.fit.cross_validation import HeldOut
from barnax.fit.table_problem import coarsened, find_best, reduced_objective
from barnax.model.prepared import prepare_record
from barnax.select.choose import Bench, Fitted, choose
from barnax.select.family import NODE_LADDER, RICHER, Point, Subfamily, limits_of
from helpers.made_cell import cell_with_ocv, ocv_v
from helpers.reference import drop_v, filtered_response, make_record

CAPACITY_AH = 2.0
NOISE_V = 5e-4


@pytest.fixture(scope="module")
def cell():
    return cell_with_ocv(CAPACITY_AH)


def driven(cell, tau_s, r_ohm, r0_ohm=0.03, bend=0.0, seed=0, half_gap_v=0.0):
    """Two hours of drive of a cell with some RC pairs, whose R0 may rise toward empty, and whose
    OCV may have a branch of each direction."""
    rng = np.random.default_rng(seed)
    current_a = np.repeat(rng.choice([-1.0, 0.0, 1.0, 2.5], 360, p=[0.3, 0.2, 0.25, 0.25]), 20)
    current_a[:60] = 0.0
    soc = 0.98 - np.concatenate([[0.0], np.cumsum(current_a)[:-1]]) / 3600 / CAPACITY_AH
    circuit = (r0_ohm + bend * np.exp(-soc / 0.2), r_ohm, tau_s)
    drop = drop_v(filtered_response, 1.0, current_a, circuit)
    # From a charge, and then that of the latest current.
    latest = np.maximum.accumulate(np.where(current_a != 0, np.arange(len(soc)), 0))
    drop += half_gap_v * np.where(current_a[latest] == 0, -1.0, np.sign(current_a[latest]))
    voltage_v = ocv_v(soc) - drop + NOISE_V * rng.standard_normal(len(soc))
    record = make_record(np.arange(len(soc), dtype=float), current_a, voltage_v, name="drive.csv")

    def prepare(circuit):
        window = Window(initial_soc=0.98, initial_direction=1)
        return [prepare_record(record, cell, circuit, window)]

    return prepare


def chosen(cell, prepare, **settings):
    own = TableSettings(resistances_follow="none", **settings)
    return choose(prepare, own, limits_of(cell, own))


@pytest.mark.parametrize(
    ("circuit", "tau_s", "r_ohm"),
    [
        ("1rc", (30.0,), (0.02,)),
        ("so-rc", (8.0, 150.0), (0.01, 0.02)),
        ("3rc", (5.0, 50.0, 450.0), (0.012, 0.012, 0.02)),
    ],
)
def test_as_many_pairs_as_the_cell_has_are_chosen(cell, circuit, tau_s, r_ohm):
    choice = chosen(cell, driven(cell, tau_s, r_ohm))
    assert (choice.chosen.point.circuit, choice.chosen.point.nodes) == (circuit, ANYWHERE)
    np.testing.assert_allclose(np.exp(choice.chosen.best.log_scales), tau_s, rtol=0.1)
    assert choice.chosen.best.rms_v == pytest.approx(NOISE_V, rel=0.1)


def test_bounds_of_a_third_pair_ask_for_it_and_pairs_of_one_box_stand_from_fast_to_slow(cell):
    prepare = driven(cell, (5.0, 50.0, 450.0), (0.012, 0.012, 0.02))
    choice = chosen(cell, prepare, bounds={"tau3 [s]": (200.0, 5000.0)})
    assert choice.chosen.point.circuit == "3rc"
    np.testing.assert_allclose(np.exp(choice.chosen.best.log_scales), (5.0, 50.0, 450.0), rtol=0.1)


def test_a_pair_whose_resistance_has_bounds_changes_places_with_no_other(cell):
    prepare = driven(cell, (8.0, 150.0), (0.01, 0.02))
    choice = chosen(cell, prepare, bounds={"R1 [Ohm]": (0.015, 0.05)})
    np.testing.assert_allclose(np.exp(choice.chosen.best.log_scales), (150.0, 8.0), rtol=0.1)
    assert choice.chosen.best.rms_v == pytest.approx(NOISE_V, rel=0.1)


def test_resistances_that_bend_with_soc_get_nodes(cell):
    choice = chosen(cell, driven(cell, (30.0,), (0.02,), bend=0.03))
    assert choice.chosen.point.circuit == "1rc"
    assert not choice.chosen.point.is_constant
    # What was kept leads from the simplest circuit to the chosen one.
    kept = [own for own in choice.tried if own.kept]
    assert [own.ladder for own in kept][:2] == [None, "nodes"]
    assert kept[-1].nodes == len(choice.chosen.point.nodes)
    assert all(own.gain.value > 1.5 * own.gain.standard_error for own in kept[1:])


@pytest.mark.parametrize(
    ("swept_a", "half_gap_v"), [(0.0, 0.004), pytest.param(0.1, 0.015, marks=pytest.mark.slow)]
)
def test_a_switched_hysteresis_is_chosen_where_the_test_has_its_gap(swept_a, half_gap_v):
    """The smaller one where it was measured at rest, one worth a tenth of the error by a sweep."""
    gapped = cell_with_ocv(CAPACITY_AH, half_gap_v, swept_a=swept_a)
    choice = chosen(gapped, driven(gapped, (8.0, 150.0), (0.01, 0.02), half_gap_v=half_gap_v))
    assert choice.chosen.point.circuit == "iso-rc"
    assert choice.chosen.best.rms_v == pytest.approx(NOISE_V, rel=0.1)
    (r0_ohm,) = choice.chosen.best.values[0]
    assert r0_ohm == pytest.approx(0.03, rel=0.01)
    # A cell without such a gap is not given one.
    plain = chosen(gapped, driven(gapped, (8.0, 150.0), (0.01, 0.02)))
    assert plain.chosen.point.circuit == "so-rc"


@pytest.mark.parametrize(("circuit", "without"), [("esc", "so-rc"), ("esc+rc", "3rc")])
def test_without_its_hysteresis_a_circuit_has_as_many_pairs(cell, circuit, without):
    limits = limits_of(cell, TableSettings(), has_ocv=True)
    assert limits.without_rate(Point(circuit, NODE_LADDER[1])) == Point(without, NODE_LADDER[1])


def test_what_is_asked_for_is_not_chosen(cell):
    prepare = driven(cell, (8.0, 150.0), (0.01, 0.02))
    settings = TableSettings(resistances_follow="none")
    choice = choose(prepare, settings, limits_of(cell, settings, "so-rc", over_soc=True))
    assert choice.chosen.point.circuit == "so-rc"
    assert choice.chosen.point.nodes in NODE_LADDER[1:]
    nothing = replace(settings, folds=0)
    alone = choose(prepare, nothing, limits_of(cell, nothing))
    assert (alone.chosen.loss, len(alone.tried)) == (None, 1)


@pytest.mark.parametrize(("folds", "wanted"), [(0, {"so-rc"}), (10, {"1rc", "esc", "iso-rc"})])
def test_a_kind_is_prepared_by_its_first_circuit_and_only_if_circuits_are_compared(folds, wanted):
    gapped = cell_with_ocv(CAPACITY_AH, 0.02)
    prepare, asked = driven(gapped, (8.0, 150.0), (0.01, 0.02)), set()

    def noted(circuit):
        asked.add(circuit)
        return prepare(circuit)

    settings = TableSettings(folds=folds)
    choose(noted, settings, limits_of(gapped, settings))
    assert asked == wanted


def test_a_kind_that_the_records_are_too_short_for_is_not_reduced(cell):
    prepare = driven(cell, (8.0, 150.0), (0.01, 0.02))

    def short(circuit):
        if circuit == "esc":
            raise InputError("too few samples")
        return prepare(circuit)

    limits = Subfamily("so-rc", richer={"so-rc": {"pairs": "3rc"}, "esc": {}})
    assert choose(short, TableSettings(), limits).chosen.point.circuit == "so-rc"


@pytest.mark.parametrize("nodes", [NODE_LADDER[0], NODE_LADDER[2]])
def test_a_coarser_circuit_from_a_finer_reduction_is_the_one_reduced_for_it(cell, nodes):
    (prepared,) = driven(cell, (8.0, 150.0), (0.01, 0.02), bend=0.02)("so-rc")
    settings = TableSettings(ocv_correction=len(nodes) > 1)
    finest = reduced_objective([prepared], replace(settings, ocv_correction=True))
    own = replace(settings, nodes=nodes)
    coarse = coarsened(finest, [prepared], own)
    alone = reduced_objective([prepared], own, coarse.ranges)
    for log_scales in np.log([(5.0, 100.0), (12.0, 300.0)]).tolist():
        one, other = (of.solve(tuple(log_scales), exact=True) for of in (coarse, alone))
        assert one.objective_v2 == pytest.approx(other.objective_v2, rel=1e-9)
    assert find_best(coarse).rms_v >= find_best(finest).rms_v * (1 - 1e-3) or len(nodes) == 1


def test_one_node_is_where_it_was_asked_for(cell):
    (prepared,) = driven(cell, (8.0, 150.0), (0.01, 0.02))("so-rc")
    anywhere = TableSettings(nodes=ANYWHERE, ocv_correction=False)
    coarse = coarsened(
        reduced_objective([prepared], anywhere), [prepared], replace(anywhere, nodes=(0.3,))
    )
    assert coarse.reduced.layout.nodes == (0.3,)


def test_rungs_add_one_thing_and_lead_back():
    limits = Subfamily("1rc", richer=RICHER)
    for circuit, nodes in product(limits.richer, limits.nodes):
        point = Point(circuit, nodes)
        for ladder, richer in limits.rungs(point):
            assert point in limits.simpler(richer)
            assert (richer.circuit != circuit) + (richer.nodes != nodes) == 1, ladder


class StatedBench(Bench):
    """A bench whose held-out errors are given by the number of nodes."""

    def __init__(self, rms_v):
        super().__init__(lambda circuit: [], TableSettings(), Subfamily("1rc"))
        self.rms_v = rms_v
        self.__dict__["_spans_enough"] = True

    def fit(self, point):
        counts = np.full((30, 3), 100)
        # Blocks differ, and by as much from circuit to circuit.
        spread = 1 + 0.02 * np.random.default_rng(len(point.nodes)).standard_normal((30, 3))
        loss = HeldOut(counts * self.rms_v[len(point.nodes)] ** 2 * spread, counts)
        objective = SimpleNamespace(settings=self.settings)
        return Fitted(point, objective, SimpleNamespace(rms_v=0.0), loss)


@pytest.mark.parametrize(
    ("rms_v", "nodes"),
    [
        ({1: 9e-3, 5: 5e-3, 9: 4.96e-3, 17: 3e-3}, 17),
        ({1: 9e-3, 5: 5e-3, 9: 4.96e-3, 17: 4.94e-3}, 5),
        ({1: 9e-3, 5: 5e-3, 9: 5.2e-3, 17: 3e-3}, 5),
        ({1: 9e-3, 5: 5e-3, 9: 4e-3, 17: 4e-3}, 9),
    ],
)
def test_nodes_that_gain_too_little_do_not_hide_finer_ones(rms_v, nodes):
    """But finer ones are not looked at behind nodes that are worse."""
    assert len(StatedBench(rms_v).chosen().chosen.point.nodes) == nodes


def test_pairs_of_one_time_constant_are_left_out(cell):
    settings = TableSettings(resistances_follow="none")
    for tau_s, is_left_out in [((8.0, 150.0), True), ((5.0, 50.0, 450.0), False)]:
        prepare = driven(cell, tau_s, (0.012,) * len(tau_s))
        bench = Bench(prepare, settings, limits_of(cell, settings))
        answer = bench._with_determined_pairs(bench.fit(Point("3rc")))
        assert answer.point.circuit == ("so-rc" if is_left_out else "3rc")
        assert [one.circuit for one in bench.tried] == ["so-rc"] * is_left_out


def test_circuits_are_compared_at_starts_that_records_tell_each_other(cell):
    """Said to start too full and too empty, which looks like more nodes near empty."""
    off_soc = 0.008
    drives = [driven(cell, (8.0, 150.0), (0.01, 0.02), seed=seed) for seed in (1, 2)]

    def prepare(circuit):
        return [
            own.in_window(replace(own.window, initial_soc=0.98 + side * off_soc))
            for drive, side in zip(drives, (1, -1), strict=True)
            for own in drive(circuit)
        ]

    settings = TableSettings(resistances_follow="none")
    choice = choose(prepare, settings, limits_of(cell, settings))
    assert choice.chosen.point == Point("so-rc")
    starts = [own.start.soc for own in choice.chosen.objective.prepared_records]
    np.testing.assert_allclose(starts, 0.98, atol=0.2 * off_soc)
    kept = choose(prepare, replace(settings, keep_starts=True), limits_of(cell, settings))
    assert not kept.chosen.point.is_constant
