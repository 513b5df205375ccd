"""Render the content of a report as HTML and PDF."""
