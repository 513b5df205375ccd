"""The output of an analysis for people and programs: reports, tables, files."""
