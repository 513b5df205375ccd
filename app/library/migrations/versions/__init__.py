"""The changes of the tables, one file for each; see ``docs/decisions/0018-two-databases.md``."""
