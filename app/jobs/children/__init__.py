"""Child processes: one for each attempt, started by a server that has loaded the science."""
