"""Nothing is lost, torn or twice, whoever is killed when; and a pool's rows have the same bits."""

import os
import random
import signal
import subprocess
import sys
import time
from pathlib import Path

import polars as pl
import pytest
from polars.testing import assert_frame_equal

from barnax.fleet import identify_fleet, read_manifest
from barnax.fleet.dataset import read_rows

from .conftest import comparable
from .test_engine import Inline

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(sys.platform != "linux", reason="looks for workers in /proc"),
]
KILLS = 20
COPIES = 8


@pytest.fixture(scope="module")
def many(small_fleet):
    """The rows of the small fleet several times, under ids of their own."""
    rows = pl.read_csv(small_fleet / "manifest.csv")
    copies = [
        rows.with_columns(id=pl.col("id") + f" {copy}", age=pl.col("age") + copy)
        for copy in range(COPIES)
    ]
    pl.concat(copies).write_csv(small_fleet / "many.csv")
    return small_fleet / "many.csv"


@pytest.fixture(scope="module")
def alone(many, tmp_path_factory):
    out = tmp_path_factory.mktemp("alone")
    identify_fleet(read_manifest(many)[0], out, executor=Inline(), batch=1)
    return comparable(read_rows(out))


def command(many, out, *more):
    words = [sys.executable, "-m", "barnax", "fleet", str(many), "--out", str(out)]
    return subprocess.Popen([*words, "--workers", "2", "--quiet", *more])


def workers_of(driver):
    try:
        found = Path(f"/proc/{driver}/task/{driver}/children").read_text().split()
    except OSError:
        return []
    lines = [(int(each), Path(f"/proc/{each}/cmdline").read_bytes()) for each in found]
    return [each for each, line in lines if b"spawn_main" in line]


def require_the_same(out, alone):
    rows = pl.read_parquet(out / "cells.parquet")
    assert rows["id"].is_unique().all()
    assert_frame_equal(comparable(rows), alone, check_exact=True, check_column_order=False)


def test_twenty_kills_lose_nothing(many, alone, tmp_path):
    draw = random.Random(0)
    killed = 0
    while killed < KILLS:
        running = command(many, tmp_path)
        time.sleep(draw.uniform(1.0, 12.0))
        victims = workers_of(running.pid)
        if victims and draw.random() < 0.5:
            os.kill(draw.choice(victims), signal.SIGKILL)
            time.sleep(draw.uniform(1.0, 4.0))
        running.kill()
        if running.wait() == 0:
            break
        killed += 1
    assert command(many, tmp_path).wait() == 0
    require_the_same(tmp_path, alone)


def test_dask_gives_the_same_rows(many, alone, tmp_path):
    pytest.importorskip("distributed")
    assert command(many, tmp_path, "--scheduler", "local").wait() == 0
    require_the_same(tmp_path, alone)
