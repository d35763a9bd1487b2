"""Our optimizers beside those that win the CEC competitions, at equal evaluations."""
