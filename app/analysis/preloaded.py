"""Imported only by the fork server: it loads the science for all children."""

from app.analysis.fork_server import load

load()
