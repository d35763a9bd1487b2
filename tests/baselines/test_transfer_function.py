"""Least squares and its recursive form on records whose circuit is known."""

TWO_PAIRS = (0.05, (0.02, 0.03), (8.0, 90.0))
CIRCUITS = {
    "1rc": (0.05, (0.03,), (20.0,)),
    "so-rc": TWO_PAIRS,
    "3rc": (0.05, (0.01, 0.02, 0.03), (2.0, 20.0, 200.0)),
}
