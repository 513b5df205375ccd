"""The page of one recording: page 1 of its report, its curve, and what a person corrects there."""
