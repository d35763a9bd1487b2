"""Circuits with tables over SOC: identified, proved, and checked on held-out blocks."""
