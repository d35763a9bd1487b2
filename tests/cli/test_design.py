"""`barnax design`: what it refuses, with nothing but the reason."""

import pytest


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (("--blocks", "foo"), "there are slow discharge; short pulses; "),
        (("--want", "foo"), "--want 'foo': write it like R0=2%"),
        (("--max-discharge", "0"), "--max-discharge: a test discharges the cell"),
        (("--temperature", "-10"), "--temperature -10: without a result"),
    ],
)
def test_a_refusal_is_all_that_is_printed(run, words, told):
    refused = run("design", "--capacity", "2", *words)
    assert refused.status == 2
    assert refused.out.strip() == ""
    assert told in refused.err
    assert "binary 4 s, binary 4 s" not in refused.err
