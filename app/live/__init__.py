"""Live sessions: the sources of frames, the raw file, and the running sessions."""
