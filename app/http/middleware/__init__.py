"""Middleware that runs before every route, and the responses for refused requests."""
