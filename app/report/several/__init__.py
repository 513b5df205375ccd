"""The report on many finished analyses: several days of a person, of both arms, or of a group."""
