"""The database: connected to, migrated, written out; its tables."""
