"""Batch runs: from a list of recordings to a folder of reports and tables."""
