"""The roads from stored files to results, taken by page, API and command line alike."""
