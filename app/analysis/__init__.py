"""The analysis pipeline from stored files to results, for page, API and command line."""
