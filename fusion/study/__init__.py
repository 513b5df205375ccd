"""Many recordings: tables, analyses in parallel, and the results of a run as a study."""
