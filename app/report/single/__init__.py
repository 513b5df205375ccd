"""The report of one recording."""
