"""Tables of samples: CSV, Parquet and register dumps; their layout, columns and dates."""
