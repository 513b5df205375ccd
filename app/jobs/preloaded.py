"""Imported by the server that children come from, and by nothing else: it loads the science for them all."""

from app.jobs.loading import ALL, load

load(ALL)
