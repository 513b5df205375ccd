"""The library: what is kept of each recording for its lists, studies and column names."""
