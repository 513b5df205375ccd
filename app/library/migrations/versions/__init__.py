"""Changes of the tables, one file each; see ``docs/decisions/0018-two-databases.md``."""
