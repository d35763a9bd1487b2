"""The command line: the only place that prints and writes files. Starts without JAX."""
