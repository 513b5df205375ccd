"""Where recordings and results are kept: a folder or a bucket."""
