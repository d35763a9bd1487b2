"""How fast everything is, against baselines that run in the same turns: see `__main__`."""
