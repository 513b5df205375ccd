"""Storage of recordings and results: a folder or a bucket."""
