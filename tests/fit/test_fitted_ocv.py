"""Tables with an OCV of the records' own, against accepted numbers and a known truth."""

from dataclasses import replace

import numpy as np
import polars as pl
import pytest
from benchmarks.operation import KINDS, NOISE_V, NOMINAL_AH, Cell

import barnax
from barnax import InputError, TableSettings, Window, characterize, read_record
from barnax.bundled import BUNDLED
from barnax.cell.parameters import OCV
from barnax.export.tables import tables_of
from barnax.fit.table_fit import pooled_errors
from barnax.model.prepared import prepare_record
from barnax.records.log import in_means
from barnax.settings import NODES
from helpers.fitted_ocv import fit_with_ocv
from helpers.made_cell import FEW_NODES, R0_OHM, R_OHM, SMALL, TAU_S, cell_with_ocv, made, ocv_v
from helpers.reference import drop_v, filtered_response, make_record

GIVEN = {"tau1 [s]": 10.0, "tau2 [s]": 100.0}
QUICK = TableSettings(nodes=FEW_NODES, max_boxes=0, folds=0)
FROM_FULL = Window(initial_soc=1.0, capacity_ah=2.0)
FAST = {"seeds": 0, "trust": "none", "max_boxes": 0}


def test_given_time_constants_give_the_accepted_errors(real_data):
    folder = real_data / "calce-inr18650-20r"
    names = ("dst_25degC_80soc", "us06_25degC_80soc")
    records = [read_record(folder / f"{name}_SP20-2.parquet") for name in names]
    profile = Window(start_after_step=3, initial_soc=1.0, score_steps=(7, 8), capacity_ah=2.0)
    windows = {each.name: profile for each in records}
    settings = replace(QUICK, nodes=NODES, fixed=GIVEN, ocv_nodes=NODES, keep_starts=True)
    fitted = fit_with_ocv(records, "so-rc", windows, settings)
    assert 1e3 * fitted.fit.objective_v == pytest.approx(9.555, rel=1e-3)
    # The cubic through the nodes is no straight line between them.
    for record, errors_mv in zip(records, [(9.60, 2.72), (8.91, 2.93)], strict=True):
        prepared = prepare_record(record, fitted.cell, "so-rc", profile)
        errors = pooled_errors([prepared], fitted.fit.tables)
        assert (1e3 * errors.rmse_v, 1e3 * errors.above_v) == pytest.approx(errors_mv, rel=0.05)


@pytest.fixture(scope="module")
def simulated():
    record, soc = made()
    settings = replace(QUICK, max_boxes=TableSettings.max_boxes)
    return record, soc, fit_with_ocv([record], "so-rc", {record.name: FROM_FULL}, settings)


def test_ocv_and_circuit_of_a_simulated_cell_are_proved_and_within_their_intervals(simulated):
    _, soc, own = simulated
    assert own.fit.status == "certified"
    assert own.fit.tables.tau_s == pytest.approx(TAU_S, rel=0.05)
    inside = np.linspace(max(0.1, soc.min()), 0.9, 50)
    assert np.max(np.abs(own.cell.average_ocv_v(inside) - ocv_v(inside))) < 3e-3
    assert own.fit.tables.at("R0 [Ohm]", inside) == pytest.approx(R0_OHM, rel=0.01)
    assert own.cell.ocv_is_fitted
    assert np.all(np.diff(own.cell.average_ocv_v(np.linspace(*own.cell.soc_range, 500))) >= 0)
    # The record is charged a little beyond where it started.
    nodes = [each for each in own.fit.intervals if each.name == OCV and each.soc > 0.23]
    assert len(nodes) > 30
    assert max(each.soc for each in nodes) > 1
    assert np.mean([each.low <= ocv_v(each.soc) <= each.high for each in nodes]) >= 0.9
    assert max(each.high - each.low for each in nodes) < 3e-3
    r0 = [each for each in own.fit.of_table("R0 [Ohm]") if 0.23 < each.soc < 0.98]
    assert np.mean([each.low <= R0_OHM <= each.high for each in r0]) >= 0.9


@pytest.mark.parametrize("half_v", [0.0, 0.05])
def test_the_ocv_of_a_nearly_empty_cell_that_no_circuit_follows_is_not_determined(half_v):
    """An overvoltage that grows with the square of the current ends in the OCV, where only loads
    visit; without it the OCV's intervals hold the truth as far as samples go."""
    record, soc = made(hours=3.1)
    over_v = half_v * record.current_a * np.abs(record.current_a) * np.exp(-soc / 0.03)
    record = replace(record, voltage_v=record.voltage_v - over_v)
    settings = replace(QUICK, nodes=(0.0, 0.05, *FEW_NODES))
    own = fit_with_ocv([record], "so-rc", {record.name: FROM_FULL}, settings)
    low = [node for node in own.fit.of_table(OCV) if node.soc <= 0.1]
    assert len(low) == 5
    if half_v:
        assert {node.low for node in low} == {None}
    else:
        assert np.mean([node.low <= ocv_v(node.soc) <= node.high for node in low]) >= 0.75
    above = [node for node in own.fit.of_table(OCV) if 0.1 < node.soc < 0.98]
    assert np.mean([node.low <= ocv_v(node.soc) <= node.high for node in above]) >= 0.9
    assert all(node.low is not None for node in own.fit.of_table("R0 [Ohm]"))


def test_resistances_of_a_pair_that_ends_at_the_slowest_are_not_determined():
    record, _ = made()
    window = {record.name: FROM_FULL}
    bounds = {"tau1 [s]": (5.0, 20.0), "tau2 [s]": (20.0, 0.5 * TAU_S[1])}
    own = fit_with_ocv([record], "so-rc", window, replace(QUICK, bounds=bounds))
    assert [hit.name for hit in own.fit.at_bound if hit.side == "upper"] == ["tau2 [s]"]
    assert {node.low for node in own.fit.of_table("R2 [Ohm]")} == {None}
    assert any(node.low is not None for node in own.fit.of_table("R1 [Ohm]"))


def test_capacity_only_names_the_axis(simulated):
    record, _, own = simulated
    spanned = fit_with_ocv([record], "so-rc", {record.name: Window()}, QUICK)
    span_ah = np.ptp(record.discharged_ah)
    assert spanned.cell.capacity_ah == pytest.approx(span_ah)
    assert spanned.windows[record.name].soc_source == "own span"
    assert spanned.fit.objective_v == pytest.approx(own.fit.objective_v, rel=0.2)
    charge_ah = np.linspace(0.2, 0.9, 30) * span_ah
    one_v = spanned.cell.average_ocv_v(1 - charge_ah / span_ah)
    assert one_v == pytest.approx(own.cell.average_ocv_v(1 - charge_ah / 2.0), abs=4e-3)


@pytest.mark.parametrize(
    ("lower_v", "is_part"), [pytest.param(0.5, False, marks=pytest.mark.slow), (0.0, True)]
)
def test_a_span_that_ends_far_from_empty_is_no_capacity_and_says_so(lower_v, is_part):
    record, _ = made(hours=1.0)
    record = replace(record, voltage_v=record.voltage_v - lower_v)
    own = fit_with_ocv([record], "so-rc", {record.name: Window()}, QUICK)
    assert ("so the cell holds more" in own.cell.capacity_origin) is is_part


def test_a_full_charge_in_the_record_is_where_soc_is_one():
    record, _ = made(charge=True, start=1.0)
    first = float(record.time_s[1300])
    window = {record.name: Window(start_time_s=first, capacity_ah=2.0)}
    own = fit_with_ocv([record], "so-rc", window, QUICK)
    started = own.windows[record.name]
    assert started.soc_source == "own full charge"
    assert started.initial_soc == pytest.approx(1.0, abs=1e-3)


@pytest.mark.slow
def test_a_second_record_starts_where_the_first_ones_ocv_has_its_rest():
    whole, _ = made(seed=0)
    rest, other = np.zeros(400), made(seed=1, start=0.7, hours=1.0)[0]
    current_a = np.concatenate([rest, other.current_a])
    voltage_v = np.concatenate([rest + ocv_v(0.7), other.voltage_v])
    interval_s = other.time_s[1]
    part = make_record(
        interval_s * 40 * np.arange(len(current_a)) / 40, current_a, voltage_v, name="part.csv"
    )
    windows = {whole.name: FROM_FULL, part.name: Window()}
    own = fit_with_ocv([whole, part], "so-rc", windows, QUICK)
    assert own.windows[part.name].initial_soc == pytest.approx(0.7, abs=5e-3)
    # It may go deeper than the record whose OCV tells its start.
    upper = replace(windows[whole.name], score_soc=(0.6, 1.0))
    both = fit_with_ocv([whole, part], "so-rc", windows | {whole.name: upper}, QUICK)
    assert both.windows[part.name].initial_soc == pytest.approx(0.7, abs=5e-3)
    assert both.cell.soc_range[0] < 0.4


@pytest.mark.parametrize("window", [Window(capacity_ah=0.9), Window(initial_soc=0.5)])
def test_a_record_that_leaves_the_axis_of_soc_says_what_it_spans(window):
    record, _ = made()
    with pytest.raises(InputError, match=r"give a larger `capacity` \(the record spans 1\.\d+ Ah"):
        fit_with_ocv([record], "so-rc", {record.name: window}, QUICK)


def test_the_cell_has_the_ocv_of_every_sample():
    record, _ = made(start=0.81, hours=1.5)
    window = Window(initial_soc=0.81, capacity_ah=2.0)
    own = fit_with_ocv([record], "so-rc", {record.name: window}, QUICK)
    prepared = prepare_record(record, own.cell, "so-rc", own.windows[record.name])
    assert not prepared.warnings


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"model": "takacs"}, "the hysteresis of takacs needs an OCV test"),
        ({"setup": "li2023"}, "the hysteresis of iso-rc needs an OCV test"),
        ({"ocv_fit": "polynomial"}, "an OCV polynomial needs an OCV test"),
    ],
)
def test_what_needs_an_ocv_test_says_so(options, message):
    with pytest.raises(InputError, match=message):
        barnax.identify(read_record(BUNDLED.record), **options)


def hysteretic(
    half_gap_v,
    gamma=30.0,
    samples=4000,
    noise_v=3e-4,
    start=1.0,
    state=1.0,
    pairs=(R_OHM, TAU_S),
    seed=4,
):
    """A drive that often charges, on a cell of known resistances whose hysteresis follows the
    charge (Plett, J. Power Sources 134 (2004) 262, Eq. 15) from a state on, and its SOC."""
    draw = np.random.default_rng(seed)
    current_a = np.repeat(
        draw.gamma(0.8, 1.0, samples) * draw.choice([1, 1, 1, -0.6, 0], samples),
        draw.integers(2, 40, samples),
    )[:samples]
    current_a[: samples // 5] = np.abs(current_a[: samples // 5])
    current_a *= (start - 0.1) * 7200 / current_a.sum()
    current_a[:60] = 0.0
    time_s = np.arange(samples, dtype=float)
    soc = start - np.append(0.0, np.cumsum(current_a[:-1])) / 7200
    states = np.empty(samples)
    for at, passed in enumerate(np.diff(soc, prepend=soc[0])):
        kept = np.exp(-gamma * abs(passed))
        state = kept * state + (1 - kept) * np.sign(passed)
        states[at] = state
    drop = drop_v(filtered_response, 1.0, current_a, (R0_OHM, *pairs))
    voltage_v = ocv_v(soc) - drop + half_gap_v * states + draw.normal(0.0, noise_v, samples)
    return make_record(time_s, current_a, voltage_v), soc


@pytest.fixture(scope="module", params=[pytest.param(0.0, marks=pytest.mark.slow), 0.006])
def turning(request):
    record, soc = hysteretic(request.param)
    return request.param, soc, barnax.identify(record, window=FROM_FULL, nodes=FEW_NODES, **FAST)


def test_a_hysteresis_is_identified_with_the_ocv_where_there_is_one(turning):
    """Else the slow pair takes it up, and its resistance is 20 % too high."""
    half_gap_v, soc, result = turning
    assert result.model == ("esc" if half_gap_v else "so-rc")
    inside = np.linspace(max(0.1, soc.min()), 0.9, 50)
    for name, r_ohm in (("R0 [Ohm]", R0_OHM), ("R1 [Ohm]", R_OHM[0]), ("R2 [Ohm]", R_OHM[1])):
        found_ohm = np.median(result.fit.tables.at(name, inside))
        assert found_ohm == pytest.approx(r_ohm, rel=0.03), name
    assert np.median(np.abs(result.cell.average_ocv_v(inside) - ocv_v(inside))) < 1e-3
    if half_gap_v:
        gap_v = result.fit.tables.at("half hysteresis [V]", inside)
        assert np.median(gap_v) == pytest.approx(half_gap_v, rel=0.15)
        assert result.fit.tables.gamma == pytest.approx(30.0, rel=0.2)


@pytest.mark.parametrize("model", [None, pytest.param("esc", marks=pytest.mark.slow)])
def test_a_hysteresis_that_turns_as_slowly_as_an_ocv_is_not_distinguished_from_it(model):
    """Over half of the range, its gap could be anything: no circuit with it is chosen, and of one
    that is asked for neither gap nor OCV is determined."""
    record, _ = hysteretic(0.02, gamma=2.0)
    asked = {"model": model, "over": "soc"} if model else {}
    result = barnax.identify(record, window=FROM_FULL, nodes=FEW_NODES, **FAST, **asked)
    told = result.fit.of_table(OCV)
    if model is None:
        assert "half hysteresis [V]" not in result.fit.tables.tables
        assert "like the OCV" in {rung.outcome for rung in result.tried}
        assert all(node.low is not None for node in told)
    else:
        gaps = result.fit.of_table("half hysteresis [V]")
        assert {node.low for node in (*told, *gaps)} == {None}
        assert any(node.low is not None for node in result.fit.of_table("R0 [Ohm]"))


@pytest.mark.slow
@pytest.mark.parametrize("half_gap_v", [0.0, 0.006])
def test_a_circuit_that_was_asked_for_without_the_hysteresis_shown_says_so(half_gap_v):
    record, _ = hysteretic(half_gap_v)
    result = barnax.identify(record, window=FROM_FULL, **SMALL)
    codes = [warning.code for warning in result.warnings]
    assert ("tables.hysteresis-left-out" in codes) is bool(half_gap_v)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("model", "noise_v", "pairs"),
    [("esc", 2e-3, (R_OHM, TAU_S)), ("esc+rc", 3e-4, ((0.010, 0.012, 0.014), (4.0, 40.0, 300.0)))],
)
def test_a_hysteresis_is_chosen_under_noise_and_beside_a_third_pair(model, noise_v, pairs):
    """Of errors that are mostly noise it lowers little; and a third pair alone imitates it, with
    slow resistances 30 to 45 % too high."""
    record, _ = hysteretic(0.008, 40.0, 12_000, noise_v, pairs=pairs)
    result = barnax.identify(record, window=FROM_FULL, **FAST)
    assert result.model == model
    inside = np.linspace(0.2, 0.8, 20)
    assert result.fit.tables.tau_s == pytest.approx(pairs[1], rel=0.1)
    for number, ohm in enumerate(pairs[0], 1):
        fitted_ohm = np.median(result.fit.tables.at(f"R{number} [Ohm]", inside))
        assert fitted_ohm == pytest.approx(ohm, rel=0.05)
    gap_v = result.fit.tables.at("half hysteresis [V]", inside)
    assert np.median(gap_v) == pytest.approx(0.008, rel=0.1)


@pytest.mark.slow
@pytest.mark.parametrize("keep_starts", [False, True])
def test_of_several_records_the_direction_is_identified_with_the_start(keep_starts):
    """A rest tells the start by the branch that it is on: the gap is 2 % SOC there, and a start
    wrong by that leaves a slow resistance 40 % too high."""
    first, _ = hysteretic(0.012, 40.0, 9000)
    second, _ = hysteretic(0.012, 40.0, 6000, start=0.5, state=-1.0, seed=5)
    second = replace(second, name="second.csv")
    given = {"window": Window(capacity_ah=2.0), "keep_starts": keep_starts, **FAST}
    result = barnax.identify([first, second], **given)
    assert result.model == "esc"
    _, part = result.of_role("identification")
    assert part.start.direction == -1
    assert part.start.soc == pytest.approx(0.5, abs=2e-3)
    r2_ohm = np.median(result.fit.tables.at("R2 [Ohm]", np.linspace(0.2, 0.7, 20)))
    assert r2_ohm == pytest.approx(R_OHM[1], rel=0.05)


LG, CALCE = "lg-hg2-18650", "calce-inr18650-20r"
TESTED = f"{CALCE}/ocv-incremental_25degC_SP20-3"
FULL = Window(start_after_step=3, initial_soc=1.0, score_steps=(7, 8))
ANOTHER = {"window": FULL, "capacity": 2.0}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("records", "test", "given", "is_wrong"),
    [
        ((f"{LG}/us06_", f"{LG}/mixed1_"), f"{LG}/c20_", {"at": "minus10degC"}, False),
        ((f"{LG}/us06_", f"{LG}/mixed1_"), f"{LG}/c20_", {"at": "0degC"}, False),
        ((f"{CALCE}/us06_0degC_80soc_SP20-2",), TESTED, {"window": FULL}, True),
        ((f"{CALCE}/dst_25degC_80soc_SP20-2",), f"{LG}/c20_25degC", ANOTHER, True),
    ],
)
def test_a_cold_cell_is_not_taken_for_another_cell(real_data, records, test, given, is_wrong):
    """In the cold more relaxes slower than any time constant reaches. Tests of another temperature
    and of another cell are told."""
    options = {"over": "soc", "max_boxes": 0, "seeds": 0, "trust": "none", **given}
    at = options.pop("at", "")
    means = [in_means(read_record(real_data / f"{name}{at}.parquet"), 1.0) for name in records]
    actual = barnax.identify(means, model="so-rc", ocv=real_data / f"{test}{at}.parquet", **options)
    assert ("ocv-test.disagrees" in {notice.code for notice in actual.warnings}) == is_wrong


def with_a_test(record, wrong):
    """The record identified with a test whose SOC is wrong by a share of the charge that is out."""
    soc = np.linspace(0, 1, 101)
    test = {"SOC": soc, "OCV [V]": ocv_v(1 - (1 - wrong) * (1 - soc))}
    given = SMALL | {"capacity": 2.0, "resistances_follow": "none", "folds": 0, "nodes": FEW_NODES}
    return barnax.identify([record], ocv=test, window=FROM_FULL, **given)


def test_what_an_ocv_test_is_worth_is_reported_and_a_wrong_one_is_warned_of(simulated):
    record, visited, _ = simulated
    soc = np.linspace(max(visited.min(), 0.1), 0.9, 81)
    right, bad = (with_a_test(record, wrong) for wrong in (0.0, 0.1))
    for result, wrong in ((right, 0.0), (bad, 0.1)):
        own = result.fit.ocv_compared
        apart_v = np.median(np.abs(ocv_v(soc) - ocv_v(1 - (1 - wrong) * (1 - soc))))
        assert own.median_v == pytest.approx(apart_v, rel=0.1, abs=1e-3)
        codes = {each.code for each in result.warnings}
        assert ("ocv-test.disagrees" in codes) == (wrong > 0)
    again = barnax.Result.model_validate_json(bad.to_json())
    assert again.fit.ocv_compared == bad.fit.ocv_compared


@pytest.mark.slow
def test_a_record_that_is_not_suitable_cannot_speak_against_its_ocv_test(tmp_path):
    """Under one constant current, slow resistances and a lower OCV look the same."""
    time_s, current_a = np.arange(0, 7600.0, 10), np.full(760, 1.0)
    current_a[[*range(20), *range(740, 760)]] = 0.0
    soc = 1 - np.append(0.0, np.cumsum(current_a[:-1])) / 720
    voltage_v = ocv_v(soc) - R0_OHM * current_a
    frame = pl.DataFrame({"Time [s]": time_s, "Current [A]": -current_a, "Voltage [V]": voltage_v})
    frame.write_csv(tmp_path / "one.csv")
    nodes = np.linspace(0, 1, 101)
    test = {"SOC": nodes, "OCV [V]": ocv_v(nodes) + 0.1 * np.sin(np.pi * nodes)}
    actual = barnax.identify(tmp_path / "one.csv", ocv=test, capacity=2.0, **SMALL)
    codes = {notice.code for notice in actual.warnings}
    assert actual.fit.ocv_compared.median_v > 0.05
    assert "role.unfit" in codes
    assert "ocv-test.disagrees" not in codes


@pytest.mark.slow
@pytest.mark.parametrize(("rise_ohm", "over"), [(0.0, "ocv"), (0.03, "soc")])
def test_resistances_vary_with_soc_only_where_that_predicts_better(rise_ohm, over):
    record, soc = made(2, noise_v=1e-3)
    fallen_v = rise_ohm * (1 - soc) * record.current_a
    record = replace(record, voltage_v=record.voltage_v - fallen_v)
    result = barnax.identify(record, window=FROM_FULL, **FAST)
    assert result.over == over
    fit = result.fit
    truth = {"R0 [Ohm]": R0_OHM, "R1 [Ohm]": R_OHM[0], "R2 [Ohm]": R_OHM[1]}
    held = [
        node.low <= ohm + rise_ohm * (1 - (node.soc or 1)) * (name == "R0 [Ohm]") <= node.high
        for name, ohm in truth.items()
        for node in fit.of_table(name)
        if node.low is not None
    ]
    assert len(held) >= 3
    assert np.mean(held) >= 0.8
    if over == "ocv":
        asked = barnax.identify(record, window=FROM_FULL, over="soc", **FAST)
        assert len(asked.fit.tables.nodes) > 1


@pytest.fixture(scope="module")
def narrow():
    """One value of each resistance at every SOC, for samples visit a fifth of it."""
    record, soc = made(1, hours=0.6)
    result = barnax.identify(record, window=FROM_FULL, **FAST)
    assert result.over == "ocv"
    return result, soc


def test_nodes_of_the_ocv_without_samples_are_reported_where_resistances_have_one_value(narrow):
    result, soc = narrow
    (notice,) = [one for one in result.warnings if one.code == "tables.mostly-unvisited"]
    nodes = result.tables.settings.ocv_nodes
    seen = [node.soc for node in result.fit.of_table(OCV)]
    assert notice.values["share"] == pytest.approx(1 - len(seen) / len(nodes))
    (caveat,) = [text for text in tables_of(result).caveats if "No sample is near SOC" in text]
    last = float(caveat.partition("SOC 0 to ")[2].partition(":")[0])
    assert soc.min() - 0.05 < last < soc.min()


@pytest.mark.slow
def test_one_node_beside_an_ocv_test_is_the_constant_circuit():
    record, _ = made(1, hours=0.6, noise_v=1e-3)
    slow = {"bounds": {"tau2 [s]": (60.0, TAU_S[1] / 2)}}
    given = {"cell": cell_with_ocv(), "window": FROM_FULL, "over": "soc", "nodes": (0.5,)}
    result = barnax.identify(record, **given, **slow, folds=0, **FAST)
    assert (result.over, result.tables) == (None, None)
    assert result.parameters["R0 [Ohm]"] == pytest.approx(R0_OHM, rel=0.02)
    assert len(result.fit.tables.nodes) == 1
    (notice,) = [warning for warning in result.warnings if warning.code == "answer.at-bound"]
    assert (notice.values["name"], notice.values["side"]) == ("tau2 [s]", "upper")


@pytest.mark.slow
@pytest.mark.parametrize("name", ["dst_25degC_80soc", "dst_45degC_80soc", "us06_25degC_80soc"])
def test_no_interval_of_a_fitted_ocv_excludes_the_rests_of_a_test(real_data, name):
    """Of another specimen, whose full charge differs by a percent of the SOC."""
    folder = real_data / CALCE
    result = barnax.identify(folder / f"{name}_SP20-2.parquet", **ANOTHER, **FAST)
    cell = characterize([read_record(real_data / f"{TESTED}.parquet")])
    scale = 2.0 / cell.capacity_ah
    for node in result.fit.of_table(OCV):
        if node.low is None or node.high is None or node.soc > 0.5:
            continue
        soc = 1 - (1 - np.array([node.soc - 0.01, node.soc + 0.01])) * scale
        half_v = np.array([-0.5, 0.5]) * cell.branch_gap_v(soc)
        low_v, high_v = cell.average_ocv_v(soc) + half_v
        assert node.low <= high_v, node.soc
        assert node.high >= low_v, node.soc
    assert all(node.low is None for node in result.fit.of_table(OCV) if node.soc < 0.09)


@pytest.mark.slow
@pytest.mark.parametrize("chosen", [{"model": "so-rc"}, {"over": "soc", "nodes": (0.5,)}])
def test_intervals_of_a_circuit_that_was_asked_for_count_its_ocv(chosen):
    """Those that take the OCV for known would miss the slow pair."""
    held = []
    truth = {"R0 [Ohm]": R0_OHM, "R1 [Ohm]": R_OHM[0], "R2 [Ohm]": R_OHM[1]}
    truth |= {"tau1 [s]": TAU_S[0], "tau2 [s]": TAU_S[1]}
    quick = {"seeds": 0, "trust": "none"}
    for seed in (0, 1, 2):
        record, _ = made(seed, noise_v=1e-3)
        result = barnax.identify(record, window=FROM_FULL, **chosen, **quick)
        assert result.over == "ocv"
        known = {node.name: node for node in result.fit.intervals if node.name in truth}
        held += [known[name].low <= value <= known[name].high for name, value in truth.items()]
        ocv = result.fit.of_table(OCV)
        inside = [node.low <= ocv_v(node.soc) <= node.high for node in ocv if node.soc < 0.98]
        assert np.mean(inside) >= 0.85
    assert len(held) == 15
    assert np.mean(held) >= 0.85


@pytest.mark.slow
def test_what_an_offset_of_the_current_would_do_is_what_it_does():
    record, _ = made(0)

    def fitted(record):
        return fit_with_ocv([record], "so-rc", {record.name: Window()}, QUICK).fit

    told = fitted(record)
    effect = told.of_offset
    moved = fitted(replace(record, current_a=record.current_a + effect.offset_a)).tables

    def total_ohm(tables):
        return tables.ohm.sum(axis=0)[list(tables.visited)]

    change = np.median(np.abs(total_ohm(moved) / total_ohm(told.tables) - 1))
    assert change > 1e-3
    assert effect.total == pytest.approx(change, rel=0.1)


@pytest.mark.slow
def test_a_hysteresis_that_slows_down_with_finer_nodes_is_left_out_and_they_stay():
    """Logs of a cell without hysteresis, to which five nodes are too few."""
    cell = Cell(*KINDS[0], 0)
    window = Window(initial_soc=1.0, capacity_ah=NOMINAL_AH)
    result = barnax.identify([*cell.logs()], window=window, **FAST)
    assert result.model == "so-rc"
    assert [rung.ladder for rung in result.tried if rung.kept][-2:] == ["without", "nodes"]
    assert result.metrics.identification.rmse_v < 1.2 * NOISE_V
