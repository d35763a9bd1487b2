"""Measurements behind the numbers of the documentation, each printed by a command."""
