"""Kept factors: equal to fits from the samples, in files that can do nothing but be read."""

import io
import json
import zipfile
from dataclasses import replace

import numpy as np
import pytest

from barnax import InputError, TableSettings, fit_tables
from barnax.fit.factor_file import _digest, factors_to_bytes, read_factors
from barnax.fit.record_factors import Grid, factors_of, fit_factors
from barnax.model.prepared import Window, prepare_record

NODES = (0.3, 0.5, 0.7, 0.85, 1.0)
GRID = Grid(low_s=4.0, high_s=250.0, nodes=NODES)
BOX = {"tau1 [s]": (5.0, 20.0), "tau2 [s]": (40.0, 200.0)}
SETTINGS = TableSettings(nodes=NODES, bounds=BOX, max_boxes=0, resistances_follow="none")


@pytest.fixture(scope="module")
def records(bundled_record, bundled_cell):
    windows = (Window(score_from_s=first, score_to_s=first + 3000.5) for first in (200.0, 2e3, 4e3))
    return [prepare_record(bundled_record, bundled_cell, "so-rc", each) for each in windows]


@pytest.fixture(scope="module")
def factors(records):
    return [factors_of(each, GRID) for each in records]


@pytest.fixture(scope="module")
def content(factors):
    return factors_to_bytes(factors)


def written(tmp_path, content):
    path = tmp_path / "a.factors.npz"
    path.write_bytes(content)
    return path


def test_a_fit_of_factors_read_back_is_the_fit_of_the_samples(records, content, tmp_path):
    ours = fit_factors(read_factors(written(tmp_path, content)), SETTINGS)
    theirs = fit_tables(records, SETTINGS)
    assert ours.objective_v == pytest.approx(theirs.objective_v, rel=1e-9)
    for name, row in theirs.tables.tables.items():
        assert ours.tables.tables[name] == pytest.approx(row, abs=1e-9)
    for one, other in zip(ours.errors, theirs.errors, strict=True):
        assert one.rmse_v == pytest.approx(other.rmse_v, rel=1e-8)
    held, its = (fit.cross_validation.by_record for fit in (ours, theirs))
    assert [one.rmse_v for one in held] == pytest.approx([one.rmse_v for one in its], rel=1e-8)
    # Where all three records are.
    known = [each for each in ours.of_table("R0 [Ohm]") if each.low is not None]
    assert known
    assert all(each.low < each.value < each.high for each in known)


def test_a_fitted_ocv_is_counted_from_one_level(records, bundled_cell):
    # The records' own levels differ; the joint OCV does not know which came first.
    points = {
        name: tuple(replace(point, row=0) for point in getattr(bundled_cell, name))
        for name in ("charge_points", "discharge_points")
    }
    cell = replace(bundled_cell, **points)
    two = [factors_of(replace(each, cell=cell), GRID) for each in records[:2]]
    one, other = fit_factors(two, SETTINGS), fit_factors(two[::-1], SETTINGS)
    ocv = [[n.value for n in fit.of_table("OCV [V]")] for fit in (one, other)]
    assert ocv[0] == pytest.approx(ocv[1], abs=1e-6)
    assert np.all(np.diff(ocv[0]) > 0)


def members_of(content):
    with np.load(io.BytesIO(content)) as arrays:
        return {name: arrays[name] for name in arrays.files}


def remade(content, **changes):
    """The file with other arrays, and the checksum that it had."""
    file = io.BytesIO()
    np.savez(file, **members_of(content) | changes)
    return file.getvalue()


def header_of(content):
    return json.loads(members_of(content)["header"].tobytes())


def as_member(header):
    return np.frombuffer(json.dumps(header).encode(), np.uint8)


def hostile(content):
    """Files that are broken, of another version, or ask for more than they hold."""
    rows = members_of(content)["rows"].copy()
    rows[3] += 1e-3
    compressed, vast, head = io.BytesIO(), io.BytesIO(), io.BytesIO()
    np.savez_compressed(compressed, **members_of(content))
    promised = {"descr": "<f8", "fortran_order": False, "shape": (10**13,)}
    np.lib.format.write_array_header_1_0(head, promised)
    with zipfile.ZipFile(io.BytesIO(content)) as given, zipfile.ZipFile(vast, "w") as packed:
        for name in given.namelist():
            packed.writestr(name, head.getvalue() if "rows" in name else given.read(name))
    objects = np.array([{"a": 1}], dtype=object)
    return {
        "checksum": remade(content, rows=rows),
        "version 7": remade(content, header=as_member(header_of(content) | {"version": 7})),
        "compressed": compressed.getvalue(),
        "no whole factor file": vast.getvalue(),
        "is no whole": remade(content, rows=objects),
        "its members": remade(content, more=rows),
        "is no factor file": content[: len(content) // 2],
    }


def test_a_file_of_somebody_else_is_refused_in_words(content, tmp_path):
    for told, given in hostile(content).items():
        with pytest.raises(InputError, match=told):
            read_factors(written(tmp_path, given))


def with_records(content, changed, arrays):
    """The file with other records in its header, and a checksum that fits."""
    header = as_member(header_of(content) | {"records": changed})
    members = members_of(content) | arrays | {"header": header}
    members["sha256"] = np.frombuffer(_digest(members), np.uint8)
    return remade(content, **members)


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("capacity_ah", 0.0), ("capacity_ah", 1e308), ("step_ohm", float("nan")),
        ("median_interval_s", float("inf")), ("scored_duration_s", 1e308), ("ocv_v", 1e308),
        ("slopes_v", float("nan")), ("low_s", float("nan")), ("nodes", float("nan")),
    ],
)  # fmt: skip
def test_a_value_that_no_record_has_is_refused_by_its_name(content, tmp_path, field, value):
    first = header_of(content)["records"][0]
    given = [value, *first[field][1:]] if isinstance(first[field], list) else value
    path = written(tmp_path, with_records(content, [first | {field: given}], {}))
    with pytest.raises(InputError) as refused:
        read_factors(path)
    assert str(path) in str(refused.value)
    assert field in str(refused.value)
    assert str(value) in str(refused.value)


def test_a_header_that_promises_other_sizes_is_refused(content, tmp_path):
    first = header_of(content)["records"][0]
    part = first["parts"][1]
    sizes = ({"rows": 4000}, {"columns": 10**9}, {"scored": -1})
    records = [[first | {"parts": [first["parts"][0], part | size]}] for size in sizes]
    records += [[first | {"low_s": 1e-300, "high_s": 1e300}], []]
    # Rows without columns are of no length in the file, and as long as any in memory.
    vast = [first | {"parts": [{"scored": 1, "rows": 4000, "columns": 0}] * 2}]
    none = {"columns": np.empty(0, "<i4"), "rows": np.empty(0)}
    for changed, arrays in [*((each, {}) for each in records), (vast, none)]:
        with pytest.raises(InputError, match="no whole factor file"):
            read_factors(written(tmp_path, with_records(content, changed, arrays)))
