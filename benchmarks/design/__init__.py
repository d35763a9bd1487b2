"""Designed tests beside HPPC and OCV tests, on known truths and on measured records."""
