"""Maintenance of an installation: backup, restore, verify, recover, doctor."""
