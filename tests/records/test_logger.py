"""The sampling of the current belongs to the logger: decided once over all its records."""

import numpy as np
import pytest

from barnax.inputs import read_inputs
from barnax.job import Job
from barnax.records import Decision, read_record, record_from_frame
from barnax.records.hold import sampled
from barnax.records.logger import Logger, SamplingEvidence, SlowRows, loggers_of
from helpers.records import CURRENT, TIME, VOLTAGE, simulated_cell
from helpers.shared import CASES, needs_cases
from records.test_hold import counted
from records.test_slow_log import log

HOLD = CASES / "systems" / "hold"


def in_time(seed, share=0.7):
    """A slow log in time with its load, some of whose levels last for one row: near the share at
    which a load is taken to change between rows."""
    rng = np.random.default_rng(seed)
    lengths = np.where(rng.random(900) < share, 1, rng.integers(2, 4, 900))
    levels_a = np.where(rng.random(900) < 0.15, 0.0, rng.normal(0.9, 1.2, 900))
    current_a = np.repeat(levels_a, lengths)[:1440]
    voltage_v = simulated_cell(current_a, 5.0, r0=0.03, capacity_ah=2.5, soc=1.0)
    voltage_v += 1e-3 * rng.standard_normal(len(voltage_v))
    return {TIME: 5.0 * np.arange(len(current_a)), CURRENT: -current_a, VOLTAGE: voltage_v}


def pooled(tables):
    """The samplings of records read together."""
    records = [record_from_frame(table, name=f"{k}") for k, table in enumerate(tables)]
    loggers = loggers_of(records)
    return [sampled(record, loggers).hold for record in records]


def test_files_made_alike_have_one_sampling():
    samplings = pooled([in_time(seed) for seed in range(24)])
    assert {each.value for each in samplings} == {"forward"}
    samplings = pooled([log(seed, "means") for seed in range(4)])
    assert {each.value for each in samplings} == {"centered"}
    assert "in 4 records" in samplings[0].reason


def test_evidence_of_all_records_decides_where_one_alone_is_wrong():
    rows = {"loaded": 1000, "alone": 360}
    bare, clear = SlowRows(**rows), SlowRows(**rows, rows=900, correlation=-450.0)
    of = {"short": bare, "long": clear}
    evidence = [SamplingEvidence(("t", "i", "u"), name, slow=slow) for name, slow in of.items()]
    alone = [Logger.of([one]).sampling(one).value for one in evidence]
    together = [Logger.of(evidence).sampling(one).value for one in evidence]
    assert (alone, together) == (["centered", "forward"], ["forward", "forward"])


@pytest.mark.parametrize("hold", ["forward", "backward"])
def test_a_proof_of_one_file_counts_for_all_of_its_logger_and_for_no_other(hold):
    proved = counted(hold, seed=3)
    columns = proved.columns
    # The counters stand still, so that they prove nothing.
    silent = proved.with_columns(**{name: 0 * proved[name] for name in columns if "Cap" in name})
    samplings = pooled([silent, proved, silent.rename({"Test Time / s": "Time / s"})])
    assert [each.strength for each in samplings] == ["weak", "strong", "assumed"]
    assert samplings[0].value == samplings[1].value == hold
    assert samplings[0].reason.startswith("in 1 at ")


def test_a_file_keeps_what_its_counters_prove_and_all_what_the_user_gives():
    other = counted("backward", seed=1)
    assert {one.value for one in pooled([other, counted("forward", seed=2)])} == {
        "forward", "backward",
    }  # fmt: skip
    given = record_from_frame(in_time(0), current_hold="centered")
    assert sampled(given, loggers_of([given, record_from_frame(in_time(1))])) is given


def test_an_undecided_record_of_a_logger_whose_records_disagree_is_as_by_itself():
    header, own = ("t",), Decision("forward", "strong", "counted")
    two = [SamplingEvidence(header, "a", own)]
    two += [SamplingEvidence(header, "b", Decision("backward", "strong", "counted"))]
    assert Logger.of(two).sampling(SamplingEvidence(header, "c")).strength == "assumed"


def test_records_of_one_call_are_of_one_logger(tmp_path, bundled_cell):
    tables = [counted("backward", seed=5), counted("backward", seed=6)]
    names = [name for name in tables[0].columns if "Capacity" in name]
    tables[0] = tables[0].with_columns(**{name: 0 * tables[0][name] for name in names})
    for k, table in enumerate(tables):
        table.write_parquet(tmp_path / f"{k}.parquet")
    assert read_record(tmp_path / "0.parquet").hold.value == "forward"
    job = Job(tmp_path / "0.parquet", validate=tmp_path / "1.parquet", cell=bundled_cell)
    inputs = read_inputs(job)
    assert [one.hold.value for one in (*inputs.records, *inputs.validation)] == ["backward"] * 2


@needs_cases
def test_two_records_of_one_logger_are_read_alike():
    records = [read_record(path) for path in sorted(HOLD.glob("*.parquet"))]
    loggers = loggers_of(records)
    together = [sampled(record, loggers).hold.value for record in records]
    assert together == [record.hold.value for record in records] == ["forward", "forward"]
