"""Imported by the server that children come from, and by nothing else: it loads the science for them all."""

from app.jobs.children.fork_server import ALL, load

load(ALL)
