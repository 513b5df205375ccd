"""Routes of recordings, uploads, analyses, batches and their files."""
