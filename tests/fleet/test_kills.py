"""Nothing is lost, torn or twice, whoever is killed when; and a pool's rows have the same bits."""

import json
import os
import random
import signal
import subprocess
import sys
import time
from contextlib import ExitStack, suppress
from pathlib import Path

import polars as pl
import pytest

from barnax.execution import AtOnce
from barnax.files import changed_ns, unfinished
from barnax.fleet import identify_fleet, read_manifest
from barnax.fleet.dataset import FACTORS, opened, read_rows

from .conftest import require_equal

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(sys.platform != "linux", reason="looks for workers in /proc"),
]
# Of each kind. A fleet that ends in between begins anew, so that there are as many.
KILLS = int(os.environ.get("BARNAX_KILLS", "20"))
KEPT = "constants"
COPIES = 16


@pytest.fixture(scope="module")
def many(small_fleet):
    """The rows of the small fleet several times, under ids of their own."""
    rows, path = pl.read_csv(small_fleet / "manifest.csv"), small_fleet / "many.csv"
    copies = [rows.with_columns(id=pl.col("id") + f" {copy}") for copy in range(COPIES)]
    pl.concat(copies).write_csv(path)
    return path


@pytest.fixture(scope="module")
def alone(many, tmp_path_factory):
    out = tmp_path_factory.mktemp("alone")
    settings = {"keep_factors": KEPT}
    identify_fleet(read_manifest(many)[0], out, executor=AtOnce(), batch=1, settings=settings)
    return read_rows(out), factors_in(out)


def factors_in(out):
    """The kept factors by name. What a killed process was writing stays aside, and is told."""
    aside = unfinished(out / FACTORS)
    return {path.name: path.read_bytes() for path in (out / FACTORS).iterdir() if path not in aside}


@pytest.fixture(params=["folder", "store"])
def dataset_at(request, tmp_path):
    """What gives a new place for a dataset: in a folder, or in a bucket of a server."""
    if request.param == "folder":
        return lambda name: tmp_path / name
    root = request.getfixturevalue("bucket")
    return lambda name: root / name


def command(many, out, *more):
    words = [sys.executable, "-m", "barnax", "fleet", str(many), "--out", str(out)]
    kept = ["--workers", "2", "--quiet", "--keep-factors", KEPT]
    return subprocess.Popen([*words, *kept, *more])


def workers_of(driver):
    try:
        actual = Path(f"/proc/{driver}/task/{driver}/children").read_text().split()
    except OSError:
        return []
    lines = [(int(each), Path(f"/proc/{each}/cmdline").read_bytes()) for each in actual]
    return [each for each, line in lines if b"spawn_main" in line]


def wait_for_cells(running, out, draw):
    """Until some while after a worker wrote factors, or the command a part, however slow they
    start; not for a command that has nothing left to do."""
    patterns = ("factors/*.npz", "parts/[!.]*.parquet")
    start_s, pattern = time.time(), draw.choice(patterns)
    while running.poll() is None and time.time() < start_s + 120:
        time.sleep(0.05)
        with suppress(FileNotFoundError):
            if any(changed_ns(each) > 1e9 * start_s for each in out.glob(pattern)):
                break
    time.sleep(draw.uniform(0.0, 3.0))


def require_the_same(out, alone):
    rows = pl.read_parquet(opened(out / "cells.parquet"))
    assert rows["id"].is_unique().all()
    require_equal(rows, alone[0])
    assert factors_in(out) == alone[1]


def test_twenty_kills_lose_nothing(many, alone, dataset_at):
    draw = random.Random(0)
    killed = {"worker": 0, "command": 0}
    fleets, out = 1, dataset_at("1")
    while min(killed.values()) < KILLS:
        running = command(many, out)
        wait_for_cells(running, out, draw)
        victims = workers_of(running.pid)
        if victims and killed["worker"] < KILLS:
            os.kill(draw.choice(victims), signal.SIGKILL)
            killed["worker"] += 1
            time.sleep(draw.uniform(1.0, 4.0))
        running.kill()
        if running.wait() == 0:
            require_the_same(out, alone)
            fleets += 1
            out = dataset_at(str(fleets))
            continue
        killed["command"] += 1
    assert command(many, out).wait() == 0
    require_the_same(out, alone)
    print(f"{killed} in {fleets} fleets")


class Cluster:
    """A Dask scheduler and two workers, started as a user starts them."""

    def __init__(self, folder, number):
        pytest.importorskip("distributed")
        file = folder / f"scheduler{number}.json"
        self.scheduler = self.start("scheduler", "--port", "0", file)
        self.workers = self.start("worker", "--nworkers", "2", "--nthreads", "1", file)
        for _ in range(600):
            if file.exists():
                break
            time.sleep(0.1)
        self.address = json.loads(file.read_text())["address"]

    def start(self, *words):
        *words, file = words
        more = ["--no-dashboard", "--scheduler-file", str(file)]
        quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
        return subprocess.Popen([sys.executable, "-m", "dask", *words, *more], **quiet)

    def __enter__(self):
        return self

    def __exit__(self, *_):
        # Workers without a scheduler would wait for it; each ends with its parent.
        for each in (self.workers, self.scheduler):
            each.kill()
            each.wait()


@pytest.mark.parametrize("is_started_here", [True, False], ids=["local", "existing"])
def test_dask_gives_the_same_rows(many, alone, tmp_path, is_started_here):
    pytest.importorskip("distributed")
    with ExitStack() as stack:
        address = "local"
        if not is_started_here:
            address = stack.enter_context(Cluster(tmp_path, 0)).address
        assert command(many, tmp_path / "out", "--scheduler", address).wait() == 0
    require_the_same(tmp_path / "out", alone)


def test_kills_of_a_scheduler_its_workers_and_the_command_lose_nothing(
    many, alone, dataset_at, tmp_path
):
    draw = random.Random(1)
    fleets, out = 1, dataset_at("1")
    for number in range(3 * KILLS):
        with Cluster(tmp_path, number) as cluster:
            running = command(many, out, "--scheduler", cluster.address)
            wait_for_cells(running, out, draw)
            victims = {
                "worker": workers_of(cluster.workers.pid),
                "scheduler": [cluster.scheduler.pid],
                "command": [running.pid],
            }
            at = victims[("worker", "scheduler", "command")[number % 3]]
            # A command that has done all is gone by itself.
            for victim in at[:1]:
                with suppress(ProcessLookupError):
                    os.kill(victim, signal.SIGKILL)
            # Without a scheduler the command ends by itself, and says so unless all was done.
            time.sleep(draw.uniform(1.0, 4.0))
            if number % 3 == 1:
                assert running.wait(60) in (0, 2)
            running.kill()
            if running.wait() == 0:
                require_the_same(out, alone)
                fleets += 1
                out = dataset_at(str(fleets))
    with Cluster(tmp_path, 3 * KILLS) as cluster:
        assert command(many, out, "--scheduler", cluster.address).wait() == 0
    require_the_same(out, alone)
