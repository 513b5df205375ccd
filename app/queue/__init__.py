"""Workers: they claim analyses and run them, on one machine or many."""
