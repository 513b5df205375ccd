"""Jobs: their rows, the queue, the workers, and the child processes that analyse."""
