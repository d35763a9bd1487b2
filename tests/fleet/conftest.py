"""A small fleet on disk: short records of one cell, and what can be wrong with one."""

import os
import socket
import subprocess
import sys
import time
import uuid

import numpy as np
import polars as pl
import pytest
from polars.testing import assert_frame_equal

from helpers.problems import drive_a
from helpers.reference import drop_v, looped_response

COLUMNS = ("Test Time / s", "Current / A", "Voltage / V")
SAMPLES = (300, 337, 350, 361)


def write_cell(path, cell, samples, seed, r0_ohm=0.05, soc=0.8):
    """A drive from a SOC on, by the reference, in a charge-positive file."""
    time_s = np.arange(samples) * 1.0
    current_a = drive_a(samples, seed)
    charge_ah = np.append(0.0, np.cumsum(current_a[:-1])) / 3600
    source_v = cell.average_ocv_v(soc - charge_ah / cell.capacity_ah)
    drop = drop_v(looped_response, time_s, current_a, (r0_ohm, (0.01, 0.02), (5.0, 80.0)))
    noise_v = np.random.default_rng(seed).normal(0, 1e-3, samples)
    columns = (time_s, -current_a, source_v - drop + noise_v)
    pl.DataFrame(dict(zip(COLUMNS, columns, strict=True))).write_parquet(path)


@pytest.fixture(scope="session")
def small_fleet(tmp_path_factory, bundled_cell):
    """A folder with a manifest of four cells, of a corrupt file and of a missing one."""
    from barnax import bundled_file

    folder = tmp_path_factory.mktemp("fleet")
    for seed, samples in enumerate(SAMPLES):
        write_cell(folder / f"cell{seed}.parquet", bundled_cell, samples, seed, 0.05 + 0.01 * seed)
    (folder / "corrupt.parquet").write_bytes(b"PAR1 and nothing else")
    ocv = ";".join(str(bundled_file(name)) for name in ("ocv_charge", "ocv_discharge"))
    rows = [(f"cell {seed}", f"cell{seed}.parquet", 100 * seed) for seed in range(len(SAMPLES))]
    rows += [("corrupt", "corrupt.parquet", 7), ("missing", "nowhere*.parquet", 8)]
    table = pl.DataFrame(rows, schema=["id", "records", "age"], orient="row")
    table = table.with_columns(ocv=pl.lit(ocv), initial_soc=0.8, circuit=pl.lit("1rc"))
    table.write_csv(folder / "manifest.csv")
    return folder


@pytest.fixture(scope="session")
def s3_server():
    """A server of S3 on this machine, which fsspec is told of by its own variables."""
    for name in ("moto", "flask_cors", "s3fs", "upath"):
        pytest.importorskip(name)
    import fsspec

    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    words = [sys.executable, "-m", "moto.server", "-H", "127.0.0.1", "-p", str(port)]
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    address = f"http://127.0.0.1:{port}"
    known = {"ENDPOINT_URL": address, "KEY": "key", "SECRET": "secret"}
    with pytest.MonkeyPatch.context() as patch:
        for name, value in known.items():
            patch.setenv(f"FSSPEC_S3_{name}", value)
        patch.setitem(fsspec.config.conf, "s3", {k.lower(): v for k, v in known.items()})
        server = subprocess.Popen(words, env={**os.environ}, **quiet)
        try:
            for _ in range(300):
                with socket.socket() as asking:
                    if asking.connect_ex(("127.0.0.1", port)) == 0:
                        break
                time.sleep(0.1)
            yield address
        finally:
            server.kill()
            server.wait()


@pytest.fixture
def bucket(s3_server):
    """A new bucket there."""
    from barnax.files import located

    actual = located(f"s3://bucket-{uuid.uuid4().hex}")
    actual.fs.mkdir(actual.path)
    return actual


def require_equal(rows, others):
    """Rows are the same to the bit, but for a clock, and for settings in other words."""
    one, other = (each.drop("seconds", "fingerprint").sort("id") for each in (rows, others))
    assert_frame_equal(one, other, check_exact=True, check_column_order=False)
