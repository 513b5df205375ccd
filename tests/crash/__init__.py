"""Kill it, cut its power, fill its disk: what was acknowledged must be there afterwards."""
