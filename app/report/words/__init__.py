"""Wording, numbers and messages in the languages of the report."""
