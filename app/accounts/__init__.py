"""Accounts and permissions: people, tokens, roles, and the start secret."""
