"""Turn row stamps into even segments: clock, repair, grid, joining."""
