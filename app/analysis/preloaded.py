"""Loaded only by the fork server: imports ``fusion`` for all children."""

from acromion.app.analysis.fork_server import load

load()
