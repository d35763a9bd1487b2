"""Models on measured cells: where hysteresis helps, where not, and why."""
