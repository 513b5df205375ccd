"""The one table from an error's class to its outcome: HTTP status, exit code, whether to try again."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import TypeVar

from app.errors import (
    AppError,
    AttemptFailed,
    BadChecksum,
    BadParameter,
    Busy,
    CannotPair,
    Crashed,
    DatabaseAway,
    DiskFull,
    FileTooLarge,
    ForeignHostName,
    ForeignWebhook,
    InternalError,
    Interrupted,
    KeyInUse,
    KeyReused,
    LockedUpload,
    NoSuchRange,
    NotAllowed,
    NotFinished,
    NotHere,
    OutOfMemory,
    OutOfTime,
    PurgedSince,
    ResultDamaged,
    ServerRefused,
    SlowUpload,
    StaleVersion,
    StoreAway,
    StoreDamaged,
    TooMany,
    UnknownProtocol,
    UnusableList,
    UnusableParticipants,
    UnusableSettings,
    UploadRefused,
    WrongDigest,
    WrongLength,
    WrongMediaType,
    WrongOffset,
    WrongVerb,
)
from fusion.errors import FusionError


@dataclass(frozen=True, slots=True)
class Outcome:
    """HTTP status, exit code of the command line, and whether trying again may help."""

    status: int
    exit_code: int
    retryable: bool = False


OUTCOMES: Mapping[type[Exception], Outcome] = {
    FusionError: Outcome(422, 3),
    BadParameter: Outcome(422, 2),
    UnusableSettings: Outcome(422, 2),
    UnusableParticipants: Outcome(422, 2),
    UnusableList: Outcome(422, 2),
    BadChecksum: Outcome(400, 2),
    UploadRefused: Outcome(400, 3, retryable=True),
    FileTooLarge: Outcome(413, 3),
    DiskFull: Outcome(507, 3, retryable=True),
    SlowUpload: Outcome(408, 3, retryable=True),
    WrongOffset: Outcome(409, 3, retryable=True),
    LockedUpload: Outcome(423, 3, retryable=True),
    WrongDigest: Outcome(460, 3, retryable=True),
    WrongLength: Outcome(400, 3),
    WrongMediaType: Outcome(415, 3),
    UnknownProtocol: Outcome(412, 3),
    Busy: Outcome(503, 3, retryable=True),
    TooMany: Outcome(429, 3, retryable=True),
    StaleVersion: Outcome(412, 3),
    KeyReused: Outcome(422, 2),
    KeyInUse: Outcome(409, 3, retryable=True),
    PurgedSince: Outcome(410, 3),
    ForeignWebhook: Outcome(422, 2),
    NotHere: Outcome(404, 3),
    NoSuchRange: Outcome(416, 2),
    CannotPair: Outcome(422, 3),
    NotFinished: Outcome(409, 3, retryable=True),
    NotAllowed: Outcome(403, 2),
    ForeignHostName: Outcome(421, 2),
    WrongVerb: Outcome(405, 2),
    ServerRefused: Outcome(503, 2),
    StoreAway: Outcome(503, 3, retryable=True),
    StoreDamaged: Outcome(410, 3),  # gone: what this address promised is not there any more, and no bug
    ResultDamaged: Outcome(410, 3, retryable=True),
    DatabaseAway: Outcome(503, 3, retryable=True),
    AttemptFailed: Outcome(500, 3),
    Interrupted: Outcome(503, 130, retryable=True),
    Crashed: Outcome(422, 3, retryable=True),
    OutOfMemory: Outcome(422, 3),
    OutOfTime: Outcome(422, 3),
    InternalError: Outcome(500, 3, retryable=True),
}


Refusal = TypeVar("Refusal", bound=Exception)


def find_outcome(error: type[Exception]) -> Outcome:
    """Look the class up, or else its nearest ancestor; a class of nobody's is a bug."""
    return next((OUTCOMES[kind] for kind in error.__mro__ if kind in OUTCOMES), OUTCOMES[InternalError])


def find_outcome_of_code(code: str) -> Outcome:
    """Do the same for the code of a refusal that was written down earlier."""
    named = {kind.code: kind for kind in list_refusals()}
    return find_outcome(named.get(code, InternalError))


def list_refusals() -> tuple[type[FusionError] | type[AppError], ...]:
    """Every class of refusal that has a code, the science's and the shell's."""
    return (*_descend(FusionError), *_descend(AppError))


def _descend(root: type[Refusal]) -> Iterator[type[Refusal]]:
    for kind in root.__subclasses__():
        yield kind
        yield from _descend(kind)
