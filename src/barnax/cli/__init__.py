"""The command line: the only place that prints and writes files. Starts without JAX."""

from .app import app, main

__all__ = ["app", "main"]
