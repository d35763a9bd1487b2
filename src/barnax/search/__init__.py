"""The search: seeds of an optimizer, their refinement, and the errors of an answer."""
