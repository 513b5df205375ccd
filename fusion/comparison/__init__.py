"""Compare measurements: two methods on one arm, both arms, several days, before and after."""
