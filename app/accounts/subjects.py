"""Who makes a request: a person, a token of a person, or the machine; and what each may do."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal, get_args

Granted = Literal["upload", "read", "correct", "release", "export", "erase", "aggregate", "people", "trail"]
"""Permissions that a token can have."""
Permission = Literal[Granted, "own"]
"""Permission that a route requires.

``upload`` a recording and request its analysis; ``read`` figures and reports on the page; ``correct`` the
details of a recording; ``release`` a report under one's name; ``export`` files; ``erase`` permanently;
``aggregate``: figures of five people or more, never of one; ``people``: accounts, which show no health data;
``trail``: the audit log; ``own``: one's account, which everyone has.
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
    """Who makes a request. ``id`` in the database and audit log: ``per_…``, ``tok_…`` or ``machine``.

    ``session``: id of the session or token, which ends with the sign-in; "" for the machine.
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
"""A caller with the start secret, or the command line."""


def collect_permissions(roles: frozenset[Role]) -> frozenset[Permission]:
    """Return the combined permissions of several roles, including "own"."""
    own: frozenset[Permission] = frozenset({"own"})
    return own | {permission for role in roles for permission in ROLES[role]}
