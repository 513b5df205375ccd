"""Is what was read believable? Stopped channels, scale, axes, clipping."""
