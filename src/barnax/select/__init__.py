"""The choice of the circuit: a family of circuits, one rule, and the circuits tried."""
