"""Which circuit is the answer: a family of circuits, one rule, and what was tried."""
