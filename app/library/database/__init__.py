"""The database: its tables, the connection, migrations, and the dump of all rows."""
