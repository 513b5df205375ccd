"""The stored data: recordings, analyses, batches, and the queue of jobs."""
