"""Who asks: a person, a token of a person, or whoever sits at the machine; and what each may do."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal, get_args

Granted = Literal["upload", "read", "correct", "release", "export", "erase", "aggregate", "people", "trail"]
"""The permissions that a token can have."""
Permission = Literal[Granted, "own"]
"""What a route asks for.

``upload`` a recording and ask for its analysis; ``read`` figures and reports on the page; ``correct`` what is
said of a recording; ``release`` a report under one's name; ``export`` files; ``erase`` for good;
``aggregate``: figures of five people or more, never of one; ``people``: accounts, which show no health data;
``trail``: who did what; ``own``: one's own login, which everybody has.
"""
PERMISSIONS: tuple[Permission, ...] = get_args(Permission)
Role = Literal["clinician", "assistant", "researcher", "employer", "manager", "auditor"]
ROLES: Mapping[Role, frozenset[Permission]] = {
    "clinician": frozenset({"upload", "read", "correct", "release", "export", "erase", "aggregate"}),
    "assistant": frozenset({"upload", "read", "correct"}),
    "researcher": frozenset({"upload", "read", "correct", "export", "aggregate"}),
    "employer": frozenset({"aggregate"}),
    "manager": frozenset({"people"}),
    "auditor": frozenset({"trail"}),
}
"""Each role is a set of permissions; a person may have several roles."""
MACHINE = "machine"

SubjectKind = Literal["person", "token", "machine"]


@dataclass(frozen=True, slots=True)
class Subject:
    """Who asks. ``id`` stands in rows and in the audit log: ``per_…``, ``tok_…`` or ``machine``.

    ``session``: what ends the moment the login ends: an id of the session or token, "" for the machine.
    """

    kind: SubjectKind
    id: str
    name: str
    permissions: frozenset[Permission]
    session: str = ""

    def may(self, permission: Permission) -> bool:
        """Return whether the subject has a permission."""
        return permission in self.permissions


AT_THE_MACHINE = Subject("machine", MACHINE, MACHINE, frozenset(PERMISSIONS))
"""Whoever holds the secret of the start, or runs the command line."""


def collect_permissions(roles: frozenset[Role]) -> frozenset[Permission]:
    """Return the permissions of several roles together, "own" included."""
    own: frozenset[Permission] = frozenset({"own"})
    return own | {permission for role in roles for permission in ROLES[role]}
