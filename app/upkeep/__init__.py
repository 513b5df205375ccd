"""Looking after an installation: backup, restore, verify, doctor."""
