"""`barnax identify --trust`: what it adds to the tables and the result."""

import json

from barnax.cli import identify as command

from .conftest import BUDGET


def test_a_run_tells_how_sure_its_parameters_are(finished):
    assert "How sure the parameters are" in finished.outcome.out
    assert "Trust: " in finished.outcome.out
    trust = json.loads((finished.folder / "result.json").read_text())["trust"]
    assert set(trust["uncertainty"]["parameters"]) >= {"R0 [Ohm]", "tau2 [s]"}
    assert trust["examination"] is None


def test_trust_full_fits_again_and_says_what_would_lower_the_error(run, finished, monkeypatch):
    monkeypatch.setattr(command, "cell_figures", lambda _: {})
    monkeypatch.setattr(command, "found_figures", lambda *_: {})
    outcome = run("identify", *BUDGET, "--trust", "full", "--out", "full")
    assert outcome.status == 0
    assert "The same by fitting again" in outcome.out
    assert "What would lower the error: " in outcome.out
    with open("full/result.json") as file:
        stored = json.load(file)
    assert stored["trust"]["examination"]["bootstrap"]["replicates"] == 200
    # Nothing else changes by looking closer.
    basic = json.loads((finished.folder / "result.json").read_text())
    assert stored["parameters"] == basic["parameters"]
    assert stored["trust"]["uncertainty"] == basic["trust"]["uncertainty"]


def test_another_word_is_refused(refuse):
    assert "'deep'" in refuse("identify", "--trust", "deep")
