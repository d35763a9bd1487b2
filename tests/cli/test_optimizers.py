"""`barnax optimizers`: every name that --method takes."""

from barnax.optimizers import OPTIMIZERS


def test_every_registered_optimizer_is_listed(run):
    outcome = run("optimizers")
    assert (outcome.status, outcome.err) == (0, "")
    listed = {line.split()[0] for line in outcome.out.splitlines() if line.split()}
    assert set(OPTIMIZERS) <= listed
