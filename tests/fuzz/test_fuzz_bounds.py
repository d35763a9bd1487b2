"""Whatever is in a file of bounds: it is refused, or gives a box that can be searched."""

import math
from pathlib import Path

import pytest
from hypothesis import strategies as st

from barnax.bounds_file import read_bounds
from barnax.errors import InputError
from barnax.model.search_space import Bounds
from helpers.hostile import EXAMPLES, NUMBER_TEXTS, STRINGS, damaged, repeated

DEFAULT = Bounds.default(capacity_ah=2.0, interval_s=1.0, duration_s=1000.0, has_rate=True)
GOOD = b'[bounds]\n"R0 [Ohm]" = [0.001, 0.1]\n"tau1 [s]" = [1, 20]\n"C2 [F]" = [100.0, 2e4]\n'
NUMBERS = ["0.1", "1e3", "1_000", "0x10", "0b1", "0xf" + "f" * 5000, "inf", "-nan", "[1]", "{}"]


def survive(folder, content: bytes) -> None:
    path = folder / "box.toml"
    path.write_bytes(content)
    try:
        changed = DEFAULT.with_changes(read_bounds(path), {}, str(path))
    except InputError as problem:
        refusal = str(problem)
    else:
        refusal = f"{path}: "
        for low, high in changed.ranges.values():
            assert 0 < low <= high < math.inf
    assert refusal.startswith(f"{path}: ")
    assert len(refusal) < 2000 + len(str(path))


@st.composite
def absurd_tables(draw: st.DrawFn) -> bytes:
    """TOML, or nearly, of absurd names and values."""
    values = st.sampled_from(NUMBERS + NUMBER_TEXTS + ["9" * 5000, "2020-01-01", "'x'", "x"])
    name = st.sampled_from([*(f'"{name}"' for name in DEFAULT.names), '"R9 [Ohm]"', "a.b", ""])
    lines = []
    for _ in range(draw(st.integers(0, 4))):
        ends = draw(st.lists(values, max_size=3))
        lines.append(f"{draw(name)} = [{', '.join(ends)}]")
    if draw(st.booleans()):
        lines.append(f'"{draw(st.sampled_from(STRINGS))}" = {draw(values)}')
    if draw(st.booleans()):
        lines.append(draw(st.sampled_from([".".join("a" * 2000) + " = 1", "x = " + "[" * 9000])))
    head = draw(st.sampled_from(["[bounds]", "[[bounds]]", "", "[bounds.x]", "[bounds]\n[more]"]))
    return "\n".join([head, *lines]).encode("utf-8", "surrogatepass")


CONTENTS = {
    "damaged": damaged([GOOD]),
    "random bytes": st.binary(max_size=200).map(lambda content: b"[bounds]\n" + content),
    "absurd": absurd_tables(),
}


@pytest.mark.parametrize("examples", EXAMPLES)
@pytest.mark.parametrize("kind", CONTENTS)
def test_whatever_is_in_a_file_of_bounds_is_read_or_refused(tmp_path, kind, examples):
    repeated(examples, lambda content: survive(tmp_path, content), CONTENTS[kind])


@pytest.mark.parametrize("name", DEFAULT.names)
@pytest.mark.parametrize("ends", [(1e-300, 1.0), (1.0, 1e299)])
def test_a_value_of_no_cell_is_refused_with_the_range(name, ends):
    far = next(end for end in ends if end != 1.0)
    for ranges, values in (({name: ends}, {}), ({}, {name: far})):
        with pytest.raises(InputError, match=r"^box: .* none of any cell; give values from"):
            DEFAULT.with_changes(ranges, values, "box")


@pytest.mark.parametrize(
    "content",
    [
        b"[bounds]\n" + b".".join([b"a"] * 7_500) + b" = 1",
        b"[bounds]\nx = " + b"[" * 15_000,
        b"[bounds]\nx = [" + b"9" * 5000 + b", 1]",
        b"[bounds]\nx = [0x" + b"f" * 5000 + b", 1]",
        b"[bounds]\nx = 0x" + b"f" * 5000,
        b'[bounds]\n"' + b"x" * 15_000 + b'" = 1',
        b"#" * 100_000,
    ],
    ids=["names", "lists", "digits", "hexadecimal", "one number", "name", "size"],
)
def test_a_bomb_is_refused_in_few_words(tmp_path, content):
    path = tmp_path / "box.toml"
    path.write_bytes(content)
    with pytest.raises(InputError, match=r"box\.toml: ") as caught:
        read_bounds(path)
    assert len(str(caught.value)) < 1000


def test_a_device_without_end_is_refused():
    with pytest.raises(InputError, match=r"is longer than 16,000 bytes|cannot be read"):
        read_bounds(Path("/dev/zero"))
