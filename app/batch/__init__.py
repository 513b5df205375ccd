"""A list of recordings in, a folder of reports and one table out."""
