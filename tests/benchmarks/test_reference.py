"""Two sets of reference numbers compared: what has moved, by how much, the furthest first."""

import json
import math
import sys

import pytest
from benchmarks.reference import compared

from benchmarks import reference

ONE = {"numbers": {"run": {"r": [0.05, 0.02], "answer": "esc", "gap": None, "at": math.nan}}}


def changed(**changes):
    return {"numbers": {"run": {**ONE["numbers"]["run"], **changes}}}


def test_a_number_moves_by_a_share_and_all_else_by_infinity():
    other = changed(r=[0.05 * (1 + 1e-6), 0.02 * (1 + 1e-12)], answer="so-rc", gap=1e-5, more=1.0)
    rows = compared(ONE, other, 1e-9)
    assert [row[1] for row in rows] == ["/run/answer", "/run/gap", "/run/more", "/run/r/0"]
    assert rows[-1][0] == pytest.approx(1e-6, rel=1e-5)
    assert all(row[0] == math.inf for row in rows[:-1])


@pytest.mark.parametrize(("moved", "status"), [(1e-12, 0), (1e-6, 1)])
def test_the_command_ends_with_1_where_a_number_has_moved(tmp_path, monkeypatch, moved, status):
    paths = [tmp_path / "one.json", tmp_path / "other.json"]
    for path, each in zip(paths, (ONE, changed(r=[0.05, 0.02 * (1 + moved)])), strict=True):
        path.write_text(json.dumps(each))
    monkeypatch.setattr(sys, "argv", ["reference", "compare", *map(str, paths)])
    with pytest.raises(SystemExit) as ended:
        reference.main()
    assert ended.value.code == status
