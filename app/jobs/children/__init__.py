"""Child processes: one for each attempt, forked from a server that has loaded the science."""
