"""Time per evaluation against other libraries' implementations of the same algorithms."""
