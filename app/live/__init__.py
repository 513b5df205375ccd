"""Live sessions: where the frames come from, the raw file they are written to, and the session they feed."""
