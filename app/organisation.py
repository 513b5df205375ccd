"""What organisations are called; it loads little, so that the command line may name one."""

import re

OWN_ORGANISATION = "own"
"""The organisation of everything that was there before organisations were: folder and database as given."""
PREFIX = "org_"
"""Every organisation's id but that of "own" begins so."""
_ID = re.compile(rf"{PREFIX}[0-9a-z]{{1,28}}")


def is_organisation(name: str) -> bool:
    """Tell the id of a further organisation from other words."""
    return _ID.fullmatch(name) is not None
