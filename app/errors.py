"""Errors of the application: each class has a code, facts and an outcome.

As in :mod:`acromion.fusion.errors`, a class has a code and facts, never a sentence.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import ClassVar, TypeVar

from acromion.fusion.caveats import TERM, name_facts
from acromion.fusion.errors import Fact, FusionError


@dataclass(frozen=True, slots=True)
class Outcome:
    """HTTP status, exit code of the command line, and whether a retry may help."""

    status: int
    exit_code: int
    retryable: bool = False


BUG = Outcome(500, 3, retryable=True)
REFUSED_BY_THE_SCIENCE = Outcome(422, 3)
"""Outcome of every :class:`acromion.fusion.errors.FusionError`, which has neither status nor exit code."""

# Codes without an exception class: nothing raises them.
UNREADABLE_PATH = "E-FILE"
NO_RECORDING = "E-NO-RECORDING"
NO_SHARDS = "E-NO-SHARDS"
NO_RESULTS = "E-NO-RESULTS"
RESULTS_IN_USE = "E-RESULTS-IN-USE"
CANCELLED = "E-CANCELLED"


class AppError(Exception):
    """Base class; ``code`` is the reason and ``facts`` fill the sentence.

    The class statement declares the code, the outcome (default: the parent's) and the possible facts, each
    with its unit or meaning.

    Attributes
    ----------
    outcome
        HTTP status and exit code.
    fact_meanings
        Allowed names in ``facts``, each with its unit or meaning.
    """

    code: ClassVar[str]
    outcome: ClassVar[Outcome] = BUG
    fact_meanings: ClassVar[Mapping[str, str]] = name_facts()

    def __init_subclass__(cls, *, code: str, outcome: Outcome | None = None, **facts: str) -> None:
        cls.code, cls.outcome = code, outcome or cls.outcome
        if facts:
            cls.fact_meanings = name_facts(**facts)

    def __init__(self, **facts: Fact) -> None:
        super().__init__(self.code, facts)
        self.facts = facts


class RecordedProblem(Exception):
    """A refusal from another process: any code, with its facts."""

    def __init__(self, code: str, facts: Mapping[str, Fact]) -> None:
        super().__init__(code, facts)
        self.code, self.facts = code, facts


class BadParameter(
    AppError,
    code="E-PARAMETER",
    outcome=Outcome(422, 2),
    name="of the parameter",
    value="as given",
    allowed="accepted values",
):
    """A parameter has an invalid value."""


class UnusableSettings(
    AppError,
    code="E-SETTINGS",
    outcome=Outcome(422, 2),
    name="setting",
    why=TERM,
    value="as written",
    allowed="accepted values",
    nearest="setting with a similar name",
    line="line",
):
    """A settings file cannot be used."""


class UnusableParticipants(
    AppError,
    code="E-PARTICIPANTS",
    outcome=Outcome(422, 2),
    why=TERM,
    cure=TERM,
    value="as written",
    allowed="accepted values",
    line="line",
    other="line of a second row",
    first="recording",
    second="recording",
    more="further rows",
):
    """Rows of a participant list cannot be used.

    Facts of the second unusable row end in ``_2``, and so on.
    """


class CannotRepeat(
    AppError, code="E-AGAIN", outcome=Outcome(422, 2), why=TERM, name="recording", more="further recordings"
):
    """A run cannot be repeated.

    Facts of the second recording end in ``_2``, and so on.
    """


class UnusableList(
    AppError, code="E-LIST", outcome=Outcome(422, 2), why=TERM, value="as written", line="line"
):
    """A list of recordings cannot be used."""


class BadChecksum(
    BadParameter, code="E-CHECKSUM", outcome=Outcome(400, 2), value="as given", allowed="accepted values"
):
    """The checksum is malformed and cannot be compared."""


class UploadRefused(AppError, code="E-UPLOAD", outcome=Outcome(400, 3, retryable=True)):
    """The upload was rejected."""


class FileTooLarge(UploadRefused, code="E-BIG", outcome=Outcome(413, 3), n="GB", max="GB"):
    """The file is larger than allowed."""


class DiskFull(UploadRefused, code="E-DISK", outcome=Outcome(507, 3, retryable=True), tries="attempts"):
    """There is too little disk space for a recording."""


class SlowUpload(UploadRefused, code="E-SLOW", outcome=Outcome(408, 3, retryable=True)):
    """The upload is too slow."""


class BrokenUpload(UploadRefused, code="E-CUT-UPLOAD"):
    """The upload ended before the announced length."""


class WrongOffset(UploadRefused, code="E-OFFSET", outcome=Outcome(409, 3, retryable=True), expected="byte"):
    """The bytes do not start where the upload stopped."""


class LockedUpload(UploadRefused, code="E-LOCKED", outcome=Outcome(423, 3, retryable=True)):
    """Another request writes to the same upload."""


class WrongDigest(UploadRefused, code="E-DIGEST", outcome=Outcome(460, 3, retryable=True)):
    """The received bytes do not match the checksum."""


class WrongLength(UploadRefused, code="E-LENGTH", outcome=Outcome(400, 3)):
    """The length is missing or wrong."""


class WrongMediaType(
    UploadRefused, code="E-MEDIA", outcome=Outcome(415, 3), found="media type", allowed="media types"
):
    """The body has an unsupported media type."""


class UnknownProtocol(UploadRefused, code="E-PROTOCOL", outcome=Outcome(412, 3), allowed="versions"):
    """The client uses an unsupported version of the upload protocol."""


class Busy(AppError, code="E-BUSY", outcome=Outcome(503, 3, retryable=True)):
    """Too many analyses are waiting."""


class TooMany(AppError, code="E-TOO-MANY", outcome=Outcome(429, 3, retryable=True), max="uploads at once"):
    """The maximum number of simultaneous uploads is reached."""


class TooManySessions(
    AppError, code="E-LIVE-FULL", outcome=Outcome(429, 3, retryable=True), max="sessions at once"
):
    """The maximum number of simultaneous live sessions is reached."""


class LiveSourceFailed(
    AppError, code="E-LIVE-SOURCE", outcome=Outcome(422, 3, retryable=True), name="of the port", why=TERM
):
    """The source of a live session sends no samples."""


class LiveStopped(AppError, code="E-LIVE-STOPPED", outcome=Outcome(503, 3, retryable=True)):
    """The process of a live session died or did not respond."""


class PurgedSince(AppError, code="E-PURGED", outcome=Outcome(410, 3)):
    """The recording of this upload has been deleted permanently."""


class ForeignWebhook(AppError, code="E-WEBHOOK", outcome=Outcome(422, 2), url="address"):
    """A webhook must not use this address."""


class OnHold(AppError, code="E-HOLD", outcome=Outcome(409, 3), id="of the recording", why=TERM):
    """The recording is on hold and must not be deleted permanently."""


class StaleVersion(AppError, code="E-STALE", outcome=Outcome(409, 3), analysis="that is newer"):
    """Another person has changed it in the meantime."""


class NotHere(AppError, code="E-NOT-FOUND", outcome=Outcome(404, 3), id="of the requested object"):
    """The page, recording or analysis does not exist."""


class NoSuchFile(NotHere, code="E-NO-FILE", name="of the file"):
    """The analysis finished without this file."""


class NoSuchRange(AppError, code="E-RANGE", outcome=Outcome(416, 2), size="bytes"):
    """The requested byte range starts after the end of the file."""


class CannotPair(AppError, code="E-PAIR", outcome=Outcome(422, 3), why=TERM, place=TERM, cure=TERM):
    """Two analyses cannot be paired."""


class CannotCompare(AppError, code="E-COMPARE", outcome=Outcome(422, 3), why=TERM):
    """Two analyses cannot be compared: they are not two days of one person, or their methods differ."""


class CannotProfile(
    AppError, code="E-DAYS", outcome=Outcome(422, 3), why=TERM, name="file or folder", other="file or folder"
):
    """The analyses are not days of one person or of one group."""


class NotFinished(AppError, code="E-NOT-FINISHED", outcome=Outcome(409, 3, retryable=True), state=TERM):
    """The analysis has not finished yet."""


class NotAllowed(AppError, code="E-NOT-ALLOWED", outcome=Outcome(403, 2)):
    """The caller is not allowed to do this."""


class NotSignedIn(NotAllowed, code="E-SIGN-IN", outcome=Outcome(401, 2)):
    """The caller has no valid session, token or secret."""


class NotPermitted(NotAllowed, code="E-PERMISSION", permission=TERM):
    """The caller lacks the required permission."""


class NotConfirmed(NotAllowed, code="E-CONFIRM"):
    """The last sign-in is too long ago for this action: the password is required again."""


class LoginRefused(NotAllowed, code="E-LOGIN", outcome=Outcome(401, 2)):
    """The sign-in name or the credential is wrong; the error does not reveal which."""


class SecondFactorLost(NotAllowed, code="E-SECOND-FACTOR", outcome=Outcome(503, 2)):
    """The authenticator's secret cannot be decrypted because the server secret has changed."""


class TooManyTries(NotAllowed, code="E-TRIES", outcome=Outcome(429, 2, retryable=True), wait_s="s"):
    """Too many failed attempts; the next one is accepted after a delay."""


class WeakPassword(
    NotAllowed, code="E-PASSWORD", outcome=Outcome(422, 2), weak=TERM, least="characters", most="characters"
):
    """The password is too common or has the wrong length."""


class TicketSpent(NotAllowed, code="E-LINK", outcome=Outcome(410, 2)):
    """A single-use link has already been used or has expired."""


class TokenInAddress(NotAllowed, code="E-TOKEN-ADDRESS", outcome=Outcome(400, 2)):
    """The address contains a token, which logs and browser histories would keep."""


class ProviderRefused(NotAllowed, code="E-PROVIDER", outcome=Outcome(401, 2, retryable=True), said=TERM):
    """The identity provider does not respond, or its response is not valid."""


class ForeignOrigin(NotAllowed, code="E-ORIGIN"):
    """Another website requested a change."""


class ForeignHostName(NotAllowed, code="E-HOST-NAME", outcome=Outcome(421, 2), host="name"):
    """The request names a host that is not one of this server's."""


class WrongVerb(
    NotAllowed, code="E-METHOD", outcome=Outcome(405, 2), method="of the request", allowed="methods"
):
    """The address does not support this method."""


class ServerRefused(AppError, code="E-SERVER", outcome=Outcome(503, 2)):
    """The server cannot start with this configuration or data."""


class ForeignAddress(ServerRefused, code="E-HOST", host="address", missing="missing protection"):
    """The server would be reachable from other computers without accounts, host names or TLS."""


class ExamplePassword(ServerRefused, code="E-EXAMPLE-PASSWORD", name="setting"):
    """The configuration uses a publicly known password from the example files."""


class PortTaken(ServerRefused, code="E-PORT", host="address", port="number"):
    """Another program already uses this address and port."""


class FolderTaken(ServerRefused, code="E-FOLDER-IN-USE", folder="path"):
    """Another server uses this data folder."""


class FolderUnusable(ServerRefused, code="E-FOLDER", folder="path", why="by the system"):
    """The data folder cannot be used."""


class FolderReadOnly(FolderUnusable, code="E-FOLDER-READ-ONLY", folder="path"):
    """The data folder is on a read-only disk."""


class FolderForbidden(FolderUnusable, code="E-FOLDER-PERMISSION", folder="path"):
    """The user of this process may not write to the data folder."""


class FolderIsFile(FolderUnusable, code="E-FOLDER-FILE", folder="path"):
    """The path of the data folder is a file."""


class DatabaseDamaged(ServerRefused, code="E-DATABASE-DAMAGED", file="path", why="by the database"):
    """The database file is damaged; it is never replaced automatically."""


class DatabaseLocked(ServerRefused, code="E-DATABASE-LOCKED", file="path", pid="process, if known"):
    """Another process holds the lock on the database and does not release it."""


class WrongSchema(ServerRefused, code="E-SCHEMA", found="revision", needed="revision"):
    """The tables or a backup belong to another version; they are left unchanged."""


class StoreMismatch(ServerRefused, code="E-STORE-OTHER", found="store", needed="store"):
    """The database belongs to another folder or bucket."""


class AccountsLost(ServerRefused, code="E-ACCOUNTS-LOST", file="path"):
    """The server has accounts, but its database contains none."""


class UnknownRecordings(ServerRefused, code="E-UNKNOWN-RECORDINGS", number="recordings", first="key of one"):
    """The store contains recordings that are missing from the database: it is lost, older or foreign."""


class NotEmpty(
    ServerRefused, code="E-NOT-EMPTY", number="rows or files", where="table, or file in the store"
):
    """A backup can only be restored into an empty data folder, store and database."""


class BackupRefused(ServerRefused, code="E-BACKUP", why="by the system"):
    """The backup cannot be written or read."""


class NotInstalled(ServerRefused, code="E-NOT-INSTALLED", name="of the package", extra="of Acromion"):
    """A package that a setting requires is not installed."""


class StoreAway(AppError, code="E-STORE", outcome=Outcome(503, 3, retryable=True)):
    """The bucket does not respond."""


class StoreDamaged(AppError, code="E-STORE-DAMAGED", outcome=Outcome(410, 3)):
    """The stored bytes differ from the received ones."""


class PurgeUnfinished(
    AppError, code="E-PURGE-UNFINISHED", outcome=Outcome(503, 3), id="of the recording", why="by the system"
):
    """A recording is hidden, but its rows remain because the database copies could not be renewed."""


class SecretUnreadable(AppError, code="E-SECRET", outcome=Outcome(503, 3), file="path"):
    """The server secret is missing, or did not encrypt this second factor or webhook."""


class StartSecretUnusable(ServerRefused, code="E-START-SECRET", file="path"):
    """The secret of a server without accounts is empty, unreadable or not a secret."""


class ResultDamaged(
    AppError,
    code="E-RESULT-DAMAGED",
    outcome=Outcome(410, 3, retryable=True),
    name="of the file",
    analysis="identity",
    again="identity of the analysis that replaces it",
):
    """A file of a finished analysis is missing or has changed."""


class DatabaseAway(
    AppError, code="E-DATABASE", outcome=Outcome(503, 3, retryable=True), why="from the system, at startup"
):
    """The database does not respond."""


class AttemptFailed(AppError, code="E-STOPPED", outcome=Outcome(500, 3)):
    """The analysis was stopped."""


class Interrupted(
    AttemptFailed,
    code="E-INTERRUPTED",
    outcome=Outcome(503, 130, retryable=True),
    times="interruptions, on a server",
):
    """The computer or the program stopped before this recording was done."""


class Crashed(AttemptFailed, code="E-CRASHED", outcome=Outcome(422, 3, retryable=True), attempts="attempts"):
    """The analysis process died too often while its worker stayed alive."""


class OutOfMemory(AttemptFailed, code="E-MEMORY", outcome=Outcome(422, 3), max="GB"):
    """The analysis needs more memory than allowed."""


class OutOfTime(AttemptFailed, code="E-TIMEOUT", outcome=Outcome(422, 3), s="s"):
    """The analysis takes longer than allowed."""


class InternalError(AttemptFailed, code="E-INTERNAL", outcome=BUG, reference="in the log"):
    """A bug; the traceback is in the log under this reference."""


@dataclass(frozen=True, slots=True)
class StudyProblem:
    """A recording that could not be compared, and the reason."""

    name: str
    code: str
    facts: Mapping[str, Fact] = field(default_factory=dict)


Refusal = TypeVar("Refusal", bound=Exception)


def find_outcome(error: type[Exception]) -> Outcome:
    """Return the outcome of an error class; an error that is not a refusal is a bug."""
    if issubclass(error, AppError):
        return error.outcome
    return REFUSED_BY_THE_SCIENCE if issubclass(error, FusionError) else BUG


def find_outcome_of_code(code: str) -> Outcome:
    """Return the outcome of the stored code of a refusal."""
    named = {kind.code: kind for kind in list_refusals()}
    return find_outcome(named.get(code, InternalError))


def list_refusals() -> tuple[type[FusionError] | type[AppError], ...]:
    """Return every error class that has a code, from ``fusion`` and ``app``."""
    return (*_descend(FusionError), *_descend(AppError))


def _descend(root: type[Refusal]) -> Iterator[type[Refusal]]:
    for kind in root.__subclasses__():
        yield kind
        yield from _descend(kind)
