"""Several days of a person, of both arms, or of a group: one report of many finished analyses."""
