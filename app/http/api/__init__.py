"""The REST API under ``/api/v1``: routes, their models, and the middleware before them."""
