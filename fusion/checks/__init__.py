"""Is what was read believable? Stuck channels, scale, axes, clipping."""
