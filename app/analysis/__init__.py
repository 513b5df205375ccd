"""From stored files to results: one pipeline for page, API and command line."""
