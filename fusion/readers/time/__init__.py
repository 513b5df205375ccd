"""From stamps of rows to even segments: clock, repair, grid, joining."""
