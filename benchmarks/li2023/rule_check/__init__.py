"""The optimizers, test functions and baselines against work that nobody here wrote."""
