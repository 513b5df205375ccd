"""Damage recordings: any damaged file must be read correctly or rejected with a code."""
