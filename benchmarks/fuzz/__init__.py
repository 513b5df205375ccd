"""Damaging recordings on purpose: whatever is done to a file, it is read honestly or refused by name."""
