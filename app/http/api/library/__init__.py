"""Routes of recordings: how they come in, their analyses, their batches and their files."""
