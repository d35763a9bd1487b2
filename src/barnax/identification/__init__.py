"""One run of `identify`: what is searched, the answer, and the flow from files to a result."""
