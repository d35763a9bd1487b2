"""From a result to its next test, and from the test's record to what was promised."""

from dataclasses import replace

import numpy as np
import pytest
from typer.testing import CliRunner

import barnax
from barnax.bundled import BUNDLED
from barnax.cell import OcvPoint, OcvTable, characterize
from barnax.cli.app import app
from barnax.cli.design import _earlier, plan_after
from barnax.cli.identify import _sampled_by
from barnax.experiment import Step
from barnax.experiment.information import before_of
from barnax.experiment.prior import prior_of
from barnax.experiment.protocol import sampled, voltage_limits_of
from barnax.model.window import Window
from barnax.plan import FileRole, Plan, plan_from_toml, plan_to_toml
from barnax.reporting.design import design_screen, reached_half
from barnax.reporting.design_forms import design_files
from barnax.reporting.first_screen import next_step
from helpers.designs import BLOCKS, quick_design
from helpers.reference import make_record
from helpers.report_reader import screen_of
from helpers.results import with_fit


@pytest.fixture(scope="module")
def design(result):
    return barnax.design(result, max_hours=1.5, blocks=BLOCKS)


@pytest.fixture(scope="module")
def prior(result):
    return prior_of(result, None)


def test_what_a_result_determines_counts(design):
    assert not design.finds_ocv
    assert design.earlier == ("identification.parquet",)
    assert design.steps[0] == Step("rest", 300.0, 0.0)
    for width in design.of_table("R1"):
        assert width.before is not None
        assert width.after < 1.1 * width.alone
    assert design.of_table("drive")[0].after < design.of_table("drive")[0].alone


def planned(folder, plan):
    """What is planned after a design of a result beside which a plan stands."""
    (folder / "plan.toml").write_text(plan_to_toml(plan))
    return _earlier(folder)


OCV_TESTS = tuple(FileRole(path=path, name=path.name, role="OCV test") for path in BUNDLED.ocv)


def test_the_test_s_record_is_identified_with_the_records_and_tests_that_counted(design, tmp_path):
    record = FileRole(path=BUNDLED.record, name="identification.parquet", role="identification")
    others = FileRole(path=BUNDLED.validation, name="validation.parquet", role="validation")
    options = {"model": "so-rc", "capacity": 2.2}
    of_all = Window(score_to_s=9.0, temperature_degc=25.0)
    parts = record, *OCV_TESTS, others
    earlier = planned(tmp_path, Plan("identify", parts, options, window=of_all))
    (tmp_path / "plan.toml").write_text(plan_to_toml(plan_after(design, earlier, 2.1)))
    (tmp_path / "record.csv").write_text("")
    plan = plan_from_toml(tmp_path / "plan.toml")
    assert [part.path for part in plan.of_role("OCV test")] == [*BUNDLED.ocv]
    own, before = plan.of_role("identification")
    assert own.path == tmp_path / "record.csv"
    assert own.window == Window(initial_soc=1.0, temperature_degc=25.0)
    assert (before.path, before.window) == (BUNDLED.record, of_all)
    assert plan.options == {"model": "so-rc", "capacity": 2.1}
    assert not plan.of_role("validation")
    # What does not count is left, and what shows what is full starts at its rest.
    alone = design.model_copy(update={"earlier": (), "start_v": 4.1})
    parts = plan_after(alone, earlier, None).parts
    assert [part.role for part in parts] == ["identification", "OCV test", "OCV test"]
    assert parts[0].window.initial_soc == 1.0
    open_start = design.model_copy(update={"start_v": 4.1})
    assert plan_after(open_start, earlier, None).parts[0].window.initial_soc is None
    assert plan_after(alone, _earlier(None), None).options == {"capacity": design.capacity_ah}


def test_a_pulse_test_that_counted_is_the_ocv_test_too(design, tmp_path):
    pulses = FileRole(path=BUNDLED.hppc[1], name="hppc.parquet", role="identification")
    plan = plan_after(design, planned(tmp_path, Plan("hppc", (pulses,))), None)
    assert plan.command == "identify"
    assert [part.path for part in plan.of_role("OCV test")] == [BUNDLED.hppc[1]]


def test_a_table_left_open_is_answered_with_a_test(result):
    opened = tuple(
        replace(each, standard_error=each.value) if each.name == "R2 [Ohm]" else each
        for each in result.fit.intervals
    )
    assert next_step(result).command != "design"
    opened_result = with_fit(result, intervals=opened)
    step = next_step(opened_result)
    assert step.command == "design"
    assert "R2" in step.advice
    # What predicts another record as well as that needs no R2 told better.
    assert next_step(validated(opened_result, 1e-3)).options == {"to": "pybamm"}


def validated(result, rmse_v):
    """The result with such an error on its record to validate on, all of it above 10 % SOC."""
    (own,) = result.metrics.validation
    errors = {"rmse_v": rmse_v, "rmse_above_10_soc_v": rmse_v, "registered_v": None}
    other = replace(own, **errors)
    metrics = result.metrics.model_copy(update={"validation": (other,)})
    return result.model_copy(update={"metrics": metrics})


@pytest.mark.parametrize(("times", "is_bad"), [(1.9, False), (2.1, True)])
def test_a_record_that_is_predicted_badly_is_answered_with_more_data(result, times, is_bad):
    step = next_step(validated(result, times * result.metrics.identification.rmse_above_10_soc_v))
    # The advice is another record, not a test to design.
    assert step.command != "design"
    assert step.advice.startswith("identify on validation.parquet too") is is_bad


def test_no_test_is_designed_for_what_is_determined_already(result, prior, tmp_path, monkeypatch):
    easy = {"R0": 0.5, "drive": 0.1}
    none = barnax.design(result, want=easy)
    assert (none.steps, none.hours, none.already) == ((), 0.0, ("R0", "drive"))
    assert not none.is_needed
    text = screen_of(design_screen(none))
    assert "No test needed: identification.parquet already determines what is wanted: R0 " in text
    (tmp_path / "design.json").write_text(none.to_json())
    assert barnax.Design.load(tmp_path).already == none.already
    assert design_files(none) == {}
    monkeypatch.setattr("barnax.design", lambda *_, **__: none)
    monkeypatch.chdir(tmp_path)
    printed = CliRunner().invoke(app, ["design", "--capacity=2", "--out=out", "--json"])
    assert printed.stdout == none.to_json()
    written = sorted(path.name for path in tmp_path.glob("*/*"))
    assert written == ["design.json", "files.json", "timings.json"]
    assert barnax.Design.load(tmp_path / "out").to_json() == none.to_json()
    monkeypatch.undo()
    # One more wish, or hours, and there is a test: of all the hours, as nothing is to be reached.
    asked = quick_design(prior, want=easy, max_hours=1.3, blocks=BLOCKS)
    assert asked.hours == pytest.approx(1.3, abs=0.02)
    shown = screen_of(design_screen(asked))
    assert "Known already:  R0 " in shown


def test_before_with_the_test_and_reached_are_one_quantity(design, result, prior):
    """What more samples narrow: no matter over what else printed intervals reach."""
    fit = result.fit
    for name in ("R0", "R1", "R2"):
        pairs = [(one.before, reached_half(fit, one)) for one in design.of_table(name)]
        before, reached = np.nanmedian(np.array(pairs, float), axis=0)
        assert before == pytest.approx(reached, rel=0.25)
    (drive,) = design.of_table("drive")
    assert drive.after < drive.before < 1.5 * drive.after
    wide = replace(fit, intervals=tuple(one.spanning([-0.03, 0.03]) for one in fit.intervals))
    part = replace(result.tables, fits=(wide,), hold_shift_ohm=0.03)
    other = result.model_copy(update={"tables": part})
    reaching = prior_of(other, None)
    assert before_of(reaching) == before_of(prior)
    assert reaching.half_widths == prior.half_widths
    assert reaching.printed["R0 [Ohm]", 0.5] > 5 * prior.printed["R0 [Ohm]", 0.5]


def test_a_test_that_falls_short_says_where_and_why(design):
    assert not design.is_reached
    text = screen_of(design_screen(design))
    for name in ("R0", "R1", "R2"):
        wide = np.median([one.after for one in design.of_table(name)])
        assert f"{name} ({100 * wide:.2g} %)" in text.partition("Not reached:")[2]
    enough = dict.fromkeys(design.wanted, 10.0)
    reached = design.model_copy(update={"wanted": enough, "is_reached": True})
    assert "Not reached" not in screen_of(design_screen(reached))


@pytest.mark.parametrize(
    ("ends_v", "window_v"), [((3.5, 3.7), (2.5, 4.2)), ((3.2, 3.35), (2.5, 3.65))]
)
def test_voltages_are_those_of_a_chemistry_or_the_narrower_where_no_full_cell_showed(
    ends_v, window_v
):
    for chemistry, usual_v in (("nmc", (2.5, 4.2)), ("lfp", (2.0, 3.65))):
        assert voltage_limits_of(prior_of(None, 2.0, chemistry).cell) == usual_v
    soc = np.linspace(0.1, 0.5, 9)
    points = tuple(
        OcvPoint(float(at), float(volts), "a.csv", row=0, rest_s=0.0)
        for at, volts in zip(soc, np.linspace(*ends_v, len(soc)), strict=True)
    )
    table = OcvTable("a.csv", {0: points}, sha256="")
    assert (
        voltage_limits_of(characterize([table], capacity_ah=2.0, ocv_fit="interpolated"))
        == window_v
    )


def test_another_capacity_leaves_the_largest_currents_in_ampere():
    prior = replace(prior_of(None, 1.0, "nmc"), rates_c=(4.0, 2.0))
    assert prior_of(prior, 2.0, "nmc").rates_c == (2.0, 1.0)


def logged(shown_a, voltage_v=3.6, begins_s=0.0):
    """A record of a test, a sample a second."""
    return make_record(begins_s + np.arange(float(len(shown_a))), shown_a, voltage_v)


def test_the_record_of_a_test_shows_how_its_current_was_sampled(design):
    current_a = sampled(design.steps)
    assert design.sampling_of(logged(current_a)) == "forward"
    before_a = np.append(current_a[0], current_a[:-1])
    assert design.sampling_of(logged(before_a)) == "backward"
    # Half of both, another test, and a clock that does not start with the test.
    assert design.sampling_of(logged((current_a + before_a) / 2)) is None
    assert design.sampling_of(logged(current_a[::-1])) is None
    assert design.sampling_of(logged(current_a, begins_s=100.0)) is None


def test_a_plan_has_the_sampling_of_its_one_record_where_the_test_s_steps_show_it(design, tmp_path):
    current_a = sampled(design.steps)
    before_a = np.append(current_a[0], current_a[:-1])
    for name, shown_a in (("test.csv", before_a), ("other.csv", current_a[::-1])):
        rows = np.column_stack([np.arange(len(shown_a)), -shown_a, 3.6 - 0.02 * shown_a])
        head = "Test Time / s,Current / A,Voltage / V"
        np.savetxt(tmp_path / name, rows, delimiter=",", header=head, comments="")

    def of(name, **options):
        own = FileRole(path=tmp_path / name, name=name, role="identification")
        others = [
            FileRole(path=tmp_path / "other.csv", name="o", role=role)
            for role in ("OCV test", "validation")
        ]
        plan = _sampled_by(design, Plan("identify", (own, *others), options))
        return [part.sampling for part in plan.parts]

    assert of("test.csv") == ["backward", None, None]
    assert of("other.csv") == of("test.csv", current_hold="forward") == [None] * 3


@pytest.mark.slow
def test_intervals_of_the_record_of_a_test_are_those_that_were_promised(design, result):
    current_a = sampled(design.steps)
    profile = {"Time [s]": np.arange(float(len(current_a))), "Current [A]": current_a}
    simulated = result.simulate(profile, initial_soc=design.initial_soc)
    noise_v = 1e-3 * np.random.default_rng(3).standard_normal(len(current_a))
    record = logged(current_a, np.asarray(simulated["Voltage [V]"]) + noise_v)
    frame = {
        "Time [s]": record.time_s, "Current [A]": record.current_a, "Voltage [V]": record.voltage_v
    }  # fmt: skip
    identified = barnax.identify(
        frame, ocv=[*BUNDLED.ocv], over="soc", model="so-rc", seeds=0, trust="none",
        max_boxes=0, folds=0, resistances_follow="none",
        window=barnax.Window(initial_soc=design.initial_soc),
        current_hold=design.sampling_of(record),
    )  # fmt: skip
    nodes = {one.soc: one for one in identified.fit.intervals if one.name == "R0 [Ohm]"}
    printed, promised = np.transpose(
        [
            ((nodes[one.soc].high - nodes[one.soc].low) / 2 / nodes[one.soc].value, one.alone)
            for one in design.of_table("R0")
        ]
    )
    assert np.median(printed) < 1.5 * np.median(promised)
