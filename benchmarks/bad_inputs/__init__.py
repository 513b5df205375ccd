"""Bad inputs by every route, compared with the expected outcome."""
