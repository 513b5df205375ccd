"""Check the plausibility of the samples: stuck channels, scale, axes, clipping."""
