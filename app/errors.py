"""What can go wrong around the science; :mod:`app.errors` says what each class comes to.

    AppError
      BadParameter     what was asked for cannot be (422)
      UnusableSettings, UnusableParticipants, UnusableList   a file that steers a run cannot be used
      UploadRefused    the bytes were not taken: FileTooLarge 413, DiskFull 507, SlowUpload 408
                       (tus: WrongOffset 409, UnknownProtocol 412, LockedUpload 423, WrongDigest 460)
      Busy             the queue is full (503); TooMany: so many uploads at once are not taken (429)
      StaleVersion     changed by somebody else meanwhile (412)
      KeyReused        the idempotency key names another request (422); KeyInUse: it is under way (409);
                       PurgedSince: what it made has been deleted for good (410)
      ForeignWebhook   a webhook may not lead there (422)
      NotHere          no such page, recording or analysis (404)
      NotFinished      the analysis has not ended yet (409)
      CannotPair       two analyses are not both arms of one shift (422)
      NoSuchFile       the analysis ended without this file (404); NoSuchRange: not so many bytes (416)
      NotAllowed       another site asks (403, 421), or a method that does not exist here (405)
      ServerRefused    the server cannot start like this: ForeignAddress, PortTaken, FolderTaken,
                       FolderUnusable (FolderReadOnly, FolderForbidden, FolderIsFile),
                       StoreMismatch, DatabaseTooOld, DatabaseTooNew, DatabaseDamaged, DatabaseLocked
                       NotInstalled, NotEmpty, BackupRefused
      DatabaseAway     the database does not answer (503); StoreAway: the bucket does not
      StoreDamaged     the stored bytes are no longer those that came (410); ResultDamaged: nor those of a
                       report, which can be made again
      AttemptFailed    the analysis was stopped: Interrupted, Crashed, OutOfMemory, OutOfTime, InternalError

As in :mod:`fusion.errors`, a class has a code and facts, never a sentence.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import ClassVar, TypeVar

from fusion.errors import Fact, FusionError


class AppError(Exception):
    """``code`` says why and ``facts`` fill the sentence."""

    code: ClassVar[str]

    def __init__(self, **facts: Fact) -> None:
        super().__init__(self.code, facts)
        self.facts = facts


class RecordedProblem(Exception):
    """A refusal that another process met: any code, with its facts."""

    def __init__(self, code: str, facts: Mapping[str, Fact]) -> None:
        super().__init__(code, facts)
        self.code, self.facts = code, facts


class BadParameter(AppError):
    """A value that cannot be. Facts: name, value, allowed."""

    code = "E-PARAMETER"


class UnusableSettings(AppError):
    """A settings file cannot be used. Facts: line or name, why, value, allowed, nearest."""

    code = "E-SETTINGS"


class UnusableParticipants(AppError):
    """A list of participants cannot be used. Facts: line, why, value, allowed."""

    code = "E-PARTICIPANTS"


class UnusableList(AppError):
    """A list of recordings cannot be used. Facts: line, why, value."""

    code = "E-LIST"


class BadChecksum(BadParameter):
    """No checksum that could be compared. Facts: value, allowed."""

    code = "E-CHECKSUM"


class UploadRefused(AppError):
    """The bytes were not taken."""

    code = "E-UPLOAD"


class FileTooLarge(UploadRefused):
    """More bytes than allowed. Facts: n, max (GB)."""

    code = "E-BIG"


class DiskFull(UploadRefused):
    """Too little space is left to take a recording."""

    code = "E-DISK"


class SlowUpload(UploadRefused):
    """The bytes came too slowly."""

    code = "E-SLOW"


class BrokenUpload(UploadRefused):
    """Fewer bytes came than were announced."""

    code = "E-CUT-UPLOAD"


class WrongOffset(UploadRefused):
    """The bytes do not begin where the upload ended. Facts: expected."""

    code = "E-OFFSET"


class LockedUpload(UploadRefused):
    """Another request writes to the same upload."""

    code = "E-LOCKED"


class WrongDigest(UploadRefused):
    """What arrived is not what was sent."""

    code = "E-DIGEST"


class WrongLength(UploadRefused):
    """The length is missing or wrong."""

    code = "E-LENGTH"


class WrongMediaType(UploadRefused):
    """The body is of a kind that is not taken here. Facts: found, allowed."""

    code = "E-MEDIA"


class UnknownProtocol(UploadRefused):
    """Another version of the upload protocol. Facts: allowed."""

    code = "E-PROTOCOL"


class Busy(AppError):
    """More work waits than is allowed."""

    code = "E-BUSY"


class TooMany(AppError):
    """As many uploads as are taken at once are under way. Facts: max."""

    code = "E-TOO-MANY"


class KeyReused(AppError):
    """The idempotency key was used for another request."""

    code = "E-KEY-REUSED"


class KeyInUse(AppError):
    """The request with this idempotency key is still under way."""

    code = "E-KEY-IN-USE"


class PurgedSince(AppError):
    """What a request with this idempotency key made has been deleted for good."""

    code = "E-PURGED"


class ForeignWebhook(AppError):
    """A webhook may not lead there. Facts: url."""

    code = "E-WEBHOOK"


class StaleVersion(AppError):
    """Somebody else has changed it meanwhile."""

    code = "E-STALE"


class NotHere(AppError):
    """No such page, recording or analysis. Facts: id, where one was named."""

    code = "E-NOT-FOUND"


class NoSuchFile(NotHere):
    """The analysis ended without this file. Facts: name."""

    code = "E-NO-FILE"


class NoSuchRange(AppError):
    """A part of a file behind its end. Facts: size (bytes)."""

    code = "E-RANGE"


class CannotPair(AppError):
    """Two analyses cannot be set side by side. Facts: why ("offset", "apart", "side", "same",
    "kept").
    """

    code = "E-PAIR"


class NotFinished(AppError):
    """The analysis has not ended yet. Facts: state."""

    code = "E-NOT-FINISHED"


class NotAllowed(AppError):
    """Not for this caller."""

    code = "E-NOT-ALLOWED"


class ForeignOrigin(NotAllowed):
    """Another web site asks for a change."""

    code = "E-ORIGIN"


class ForeignHostName(NotAllowed):
    """The request names a host that this server is not. Facts: host."""

    code = "E-HOST-NAME"


class WrongVerb(NotAllowed):
    """The address does not know this method. Facts: method."""

    code = "E-METHOD"


class ServerRefused(AppError):
    """The server cannot start like this."""

    code = "E-SERVER"


class ForeignAddress(ServerRefused):
    """Only loopback is served until accounts exist. Facts: host."""

    code = "E-HOST"


class PortTaken(ServerRefused):
    """Another program listens there. Facts: host, port."""

    code = "E-PORT"


class FolderTaken(ServerRefused):
    """Another server works in this data folder. Facts: folder."""

    code = "E-FOLDER-IN-USE"


class FolderUnusable(ServerRefused):
    """The data folder cannot be used. Facts: folder, why."""

    code = "E-FOLDER"


class FolderReadOnly(FolderUnusable):
    """The data folder is on a disk that can only be read. Facts: folder."""

    code = "E-FOLDER-READ-ONLY"


class FolderForbidden(FolderUnusable):
    """The user of this process may not write in the data folder. Facts: folder."""

    code = "E-FOLDER-PERMISSION"


class FolderIsFile(FolderUnusable):
    """A file stands where the data folder should be. Facts: folder."""

    code = "E-FOLDER-FILE"


class DatabaseDamaged(ServerRefused):
    """The file of the database is damaged; it is never replaced by itself. Facts: file, why."""

    code = "E-DATABASE-DAMAGED"


class DatabaseLocked(ServerRefused):
    """Another process holds the database and does not let go. Facts: file, pid (where it is known)."""

    code = "E-DATABASE-LOCKED"


class DatabaseTooOld(ServerRefused):
    """The tables are of an earlier release, and only the server migrates. Facts: found, needed."""

    code = "E-DATABASE-OLD"


class DatabaseTooNew(ServerRefused):
    """The tables are of a later release. Facts: found, needed."""

    code = "E-DATABASE-NEW"


class StoreMismatch(ServerRefused):
    """The database belongs to another folder or bucket. Facts: found, needed."""

    code = "E-STORE-OTHER"


class UnknownRecordings(ServerRefused):
    """The store holds recordings that the database does not know: it is lost, older or foreign."""

    code = "E-UNKNOWN-RECORDINGS"


class NotEmpty(ServerRefused):
    """A backup is restored only where nothing is. Facts: number, where (a table, or a file in the store)."""

    code = "E-NOT-EMPTY"


class BackupRefused(ServerRefused):
    """The backup cannot be written or read as it is. Facts: why."""

    code = "E-BACKUP"


class NotInstalled(ServerRefused):
    """What many machines need is not installed. Facts: name."""

    code = "E-NOT-INSTALLED"


class StoreAway(AppError):
    """The bucket does not answer."""

    code = "E-STORE"


class StoreDamaged(AppError):
    """The stored bytes are no longer those that came."""

    code = "E-STORE-DAMAGED"


class ResultDamaged(AppError):
    """A file of a finished analysis is missing or not what was made. Facts: name, analysis, again (the
    analysis that replaces it, where there is one).
    """

    code = "E-RESULT-DAMAGED"


class DatabaseAway(AppError):
    """The database does not answer. Facts: why, at a start."""

    code = "E-DATABASE"


class AttemptFailed(AppError):
    """The analysis was stopped."""

    code = "E-STOPPED"


class Interrupted(AttemptFailed):
    """The computer or the program ended before this recording was done. Facts: times, on a server."""

    code = "E-INTERRUPTED"


class Crashed(AttemptFailed):
    """The analysis died as often as is allowed, while its worker lived. Facts: attempts."""

    code = "E-CRASHED"


class OutOfMemory(AttemptFailed):
    """The analysis needs more memory than allowed. Facts: max (GB)."""

    code = "E-MEMORY"


class OutOfTime(AttemptFailed):
    """The analysis takes longer than allowed. Facts: s."""

    code = "E-TIMEOUT"


class InternalError(AttemptFailed):
    """A bug; the traceback is in the log under this reference. Facts: reference."""

    code = "E-INTERNAL"


@dataclass(frozen=True, slots=True)
class StudyProblem:
    """What could not be compared, and why."""

    name: str
    code: str
    facts: Mapping[str, Fact] = field(default_factory=dict)


# The one table from an error's class to its outcome: HTTP status, exit code, whether to try again.


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
