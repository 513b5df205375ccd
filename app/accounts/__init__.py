"""Who asks, and what they may do: people, tokens, roles, and the secret of the start."""
