"""The page of one recording: page 1 of its report, its curve, and its corrections."""
