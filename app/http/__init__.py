"""The HTTP interface: API, pages and the middleware of both."""
