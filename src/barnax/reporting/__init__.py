"""Reports of an identification, a comparison, a fleet or a check: every sentence and table.

A report is first a `Document`, made from results alone; `to_html`, `to_markdown` and `to_terminal`
say the same. Nothing here writes a file.
"""
