"""One logger of a fleet: a sample of its files decides for all, whoever identifies which."""

from dataclasses import replace

import polars as pl
import pytest

from barnax import Reading, read_manifest, read_record
from barnax.fleet.engine import SAMPLED, loggers_of_fleet
from barnax.fleet.rows import sources_of
from helpers.records import CURRENT, TIME, VOLTAGE
from records.test_logger import in_time


@pytest.fixture(scope="module")
def cells(tmp_path_factory):
    """Twenty-four logs of one logger, some too short to show alone what it does."""
    folder = tmp_path_factory.mktemp("logs")
    for k in range(24):
        table = pl.DataFrame(in_time(k)).head(1440 if k % 3 else 70)
        table.write_parquet(folder / f"c{k}.parquet")
    rows = [{"id": f"c{k}", "records": f"c{k}.parquet"} for k in range(24)]
    pl.DataFrame(rows).write_csv(folder / "manifest.csv")
    return read_manifest(folder / "manifest.csv")[0]


def sampling(cell, loggers):
    (source,) = sources_of(cell.records, Reading(), loggers)
    return read_record(source).hold


def test_every_file_of_one_logger_has_the_same_sampling(cells):
    loggers = loggers_of_fleet(cells, {})
    assert loggers == loggers_of_fleet(cells[::-1], {})
    # Whatever else each cell asks for.
    asking = [replace(cell, options={"seeds": k}) for k, cell in enumerate(cells)]
    assert loggers == loggers_of_fleet(asking, {})
    assert set(loggers) == {(TIME, CURRENT, VOLTAGE)}
    assert {sampling(cell, loggers).value for cell in cells} == {"forward"}
    # By itself, a short one shows nothing but how often its load changes.
    assert {sampling(cell, {}).value for cell in cells} == {"forward", "centered"}
    assert loggers[TIME, CURRENT, VOLTAGE].slow_records <= SAMPLED
