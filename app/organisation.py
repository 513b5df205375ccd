"""What organisations are called; it loads nothing, so that the command line may name one."""

OWN_ORGANISATION = "own"
"""The organisation of everything that was there before organisations were: folder and database as given."""
PREFIX = "org_"
"""Every organisation's id but that of "own" begins so."""
