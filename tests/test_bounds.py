import math

import pytest

from barnax.errors import InputError
from barnax.model.search_space import Bounds, parse_fixed, read_bounds

DEFAULT = Bounds.default(capacity_ah=2.0, interval_s=1.0, duration_s=1000.0)
TAUS = ("tau1 [s]", "tau2 [s]")


@pytest.mark.parametrize(
    ("capacity_ah", "low_ohm", "high_ohm"),
    # 0.1 to 200 mohm at 2 Ah; a 33 Ah cell has 2/33 of it.
    [(2.0, 1e-4, 0.2), (33.0, 6.0606060606e-6, 0.012121212121)],
)
def test_resistances_scale_with_the_capacity(capacity_ah, low_ohm, high_ohm):
    ranges = Bounds.default(capacity_ah, 1.0, 1000.0).ranges
    for name in ("R0 [Ohm]", "R1 [Ohm]", "R2 [Ohm]"):
        assert ranges[name] == pytest.approx((low_ohm, high_ohm), rel=1e-9)


def test_time_constants_run_from_half_an_interval_to_the_scored_duration():
    ranges = Bounds.default(2.0, interval_s=1.016, duration_s=10_800.0).ranges
    assert [ranges[name] for name in TAUS] == [(0.508, 10_800.0)] * 2


def test_a_record_of_one_interval_still_has_a_box():
    low, high = Bounds.default(2.0, interval_s=10.0, duration_s=0.0).ranges["tau1 [s]"]
    assert low < high


def test_both_pairs_have_one_box_by_default():
    assert DEFAULT.pairs_are_alike


def test_a_range_replaces_the_default():
    changed = DEFAULT.with_changes({"R0 [Ohm]": (0.01, 0.02)}, {}, "bounds.toml")
    assert changed.ranges["R0 [Ohm]"] == (0.01, 0.02)
    assert changed.pairs_are_alike


def test_a_capacitance_range_replaces_that_of_the_time_constant():
    changed = DEFAULT.with_changes({"C1 [F]": (20.0, 100.0)}, {}, "bounds.toml")
    assert "tau1 [s]" not in changed.ranges
    assert changed.second_name(0) == "C1 [F]"
    assert changed.second_name(1) == "tau2 [s]"


@pytest.mark.parametrize("name", ["R1 [Ohm]", "R2 [Ohm]", "tau1 [s]", "tau2 [s]"])
def test_a_range_of_one_pair_makes_the_pairs_differ(name):
    assert not DEFAULT.with_changes({name: (0.01, 0.1)}, {}, "").pairs_are_alike


def test_a_capacitance_of_one_pair_makes_the_pairs_differ():
    assert not DEFAULT.with_changes({"C1 [F]": (20.0, 500.0)}, {}, "").pairs_are_alike


def test_a_capacitance_leaves_only_resistances_whose_time_constant_can_be_seen():
    changed = DEFAULT.with_changes({"C1 [F]": (20.0, 50.0)}, {}, "")
    assert changed.ranges["R1 [Ohm]"] == (DEFAULT.tau_limits_s[0] / 50.0, 0.2)
    assert changed.ranges["R2 [Ohm]"] == DEFAULT.ranges["R2 [Ohm]"]


@pytest.mark.parametrize(
    ("ranges", "fixed"),
    [
        ({"C1 [F]": (0.01, 0.1)}, {}),
        ({}, {"C2 [F]": 1e-3}),
        ({}, {"R1 [Ohm]": 1e-3, "C1 [F]": 1.0}),
    ],
)
def test_a_capacitance_whose_time_constant_cannot_be_seen_is_refused(ranges, fixed):
    with pytest.raises(InputError, match=r"R C\s+leaves 0.5 to \d+ s.*widen one of them"):
        DEFAULT.with_changes(ranges, fixed, "bounds.toml")


def test_equal_ranges_of_both_pairs_keep_them_alike():
    ranges = dict.fromkeys(("C1 [F]", "C2 [F]"), (20.0, 5000.0))
    assert DEFAULT.with_changes(ranges, {}, "").pairs_are_alike


@pytest.mark.parametrize(("name", "is_alike"), [("R0 [Ohm]", True), ("R2 [Ohm]", False)])
def test_a_fixed_value_of_a_pair_makes_the_pairs_differ(name, is_alike):
    assert DEFAULT.with_changes({}, {name: 0.01}, "").pairs_are_alike is is_alike


def test_a_fixed_value_is_no_longer_searched():
    changed = DEFAULT.with_changes({}, {"C2 [F]": 500.0, "R0 [Ohm]": 0.05}, "--fix")
    assert changed.fixed == {"C2 [F]": 500.0, "R0 [Ohm]": 0.05}
    assert set(changed.ranges) == {"R1 [Ohm]", "R2 [Ohm]", "tau1 [s]"}


def test_changes_leave_the_earlier_bounds_as_they_were():
    before = dict(DEFAULT.ranges)
    DEFAULT.with_changes({"R0 [Ohm]": (0.01, 0.02)}, {"C1 [F]": 500.0}, "")
    assert DEFAULT.ranges == before


@pytest.mark.parametrize(
    ("ranges", "fixed", "message"),
    [
        (
            {"R9 [Ohm]": (0.1, 0.2)},
            {},
            r"'R9 \[Ohm\]' is not a parameter of this circuit; there are R0 \[Ohm\]",
        ),
        ({"R0 [Ohm]": (0.2, 0.1)}, {}, r"'R0 \[Ohm\]' are \[0.2, 0.1\]; .* the lower one smaller"),
        ({"R0 [Ohm]": (0.1, 0.1)}, {}, r"'R0 \[Ohm\]' are \[0.1, 0.1\]"),
        ({"R0 [Ohm]": (0.0, 0.1)}, {}, r"'R0 \[Ohm\]' are \[0.0, 0.1\]; they must be positive"),
        ({"C1 [F]": (1.0, math.inf)}, {}, r"'C1 \[F\]' are \[1.0, inf\]"),
        ({"C1 [F]": (math.nan, 2.0)}, {}, r"'C1 \[F\]' are \[nan, 2.0\]"),
        ({}, {"C3 [F]": 1.0}, r"'C3 \[F\]' is not a parameter"),
        ({}, {"C1 [F]": -500.0}, r"'C1 \[F\]' cannot be fixed at -500.0; give a positive value"),
        ({}, {"C1 [F]": math.nan}, r"'C1 \[F\]' cannot be fixed at nan"),
        ({"C1 [F]": (1.0, 2.0)}, {"C1 [F]": 1.5}, r"'C1 \[F\]' is both bounded and fixed"),
        (
            {"C1 [F]": (1.0, 2.0), "tau1 [s]": (1.0, 2.0)},
            {},
            r"give 'tau1 \[s\]' or 'C1 \[F\]', not both",
        ),
        ({"C2 [F]": (1.0, 2.0)}, {"tau2 [s]": 1.5}, r"give 'tau2 \[s\]' or 'C2 \[F\]', not both"),
    ],
)
def test_a_box_that_cannot_be_is_refused_with_its_source_name_and_value(ranges, fixed, message):
    with pytest.raises(InputError, match=r"box\.toml: .*" + message):
        DEFAULT.with_changes(ranges, fixed, "box.toml")


def test_bounds_are_read_from_a_toml_table(tmp_path):
    path = tmp_path / "box.toml"
    path.write_text('[bounds]\n"R0 [Ohm]" = [0.001, 1]\n"tau1 [s]" = [1, 20]\n')
    assert read_bounds(path) == {"R0 [Ohm]": (0.001, 1.0), "tau1 [s]": (1.0, 20.0)}


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"[bounds", "is not a TOML file"),
        (b"\xff\xfe\x00\x01", "is not a TOML file"),
        (b"", r"must hold one table, \[bounds\]"),
        (b'"R0 [Ohm]" = [0.1, 0.2]\n', r"must hold one table, \[bounds\], with lines like"),
        (b"[bounds]\n[more]\n", "must hold one table"),
        (b"bounds = 3\n", "must hold one table"),
        (b'[bounds]\n"R0 [Ohm]" = 0.1\n', r"'R0 \[Ohm\]' must be two numbers.* it is 0.1"),
        (b'[bounds]\n"R0 [Ohm]" = [1, 2, 3]\n', r"'R0 \[Ohm\]' must be two numbers"),
        (b'[bounds]\n"R0 [Ohm]" = ["1", 2]\n', r"'R0 \[Ohm\]' must be two numbers"),
        (b'[bounds]\n"R0 [Ohm]" = [true, 2]\n', r"'R0 \[Ohm\]' must be two numbers"),
    ],
)
def test_a_bounds_file_that_says_something_else_is_refused_by_name(tmp_path, content, message):
    path = tmp_path / "box.toml"
    path.write_bytes(content)
    with pytest.raises(InputError, match=r"box\.toml: " + message):
        read_bounds(path)


def test_a_bounds_file_that_is_missing_is_refused_by_name(tmp_path):
    with pytest.raises(InputError, match=r"box\.toml: cannot be read \(No such file"):
        read_bounds(tmp_path / "box.toml")


def test_a_folder_of_bounds_is_refused_by_name(tmp_path):
    with pytest.raises(InputError, match=r"cannot be read \(Is a directory"):
        read_bounds(tmp_path)


def test_fixed_values_are_a_name_and_a_number():
    assert parse_fixed(["C1 [F]=500", " R0 [Ohm] = 5e-2"]) == {"C1 [F]": 500.0, "R0 [Ohm]": 0.05}


@pytest.mark.parametrize("text", ["C1 [F]", "C1 [F]=", "C1 [F]=many", "=", "C1 [F]=1=2"])
def test_a_fixed_value_written_otherwise_is_refused_with_an_example(text):
    with pytest.raises(InputError, match=r'--fix .* such as "C1 \[F\]=500"'):
        parse_fixed([text])


@pytest.mark.parametrize("digits", [401, 5000])
def test_a_number_of_hundreds_of_digits_is_refused(tmp_path, digits):
    path = tmp_path / "box.toml"
    path.write_text(f'[bounds]\n"R0 [Ohm]" = [0, {"9" * digits}]\n')
    with pytest.raises(InputError, match=r"box\.toml"):
        read_bounds(path)
