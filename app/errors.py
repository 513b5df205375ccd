"""What can go wrong around the science, each class with its code, its facts and what it comes to.

As in :mod:`fusion.errors`, a class has a code and facts, never a sentence.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import ClassVar, TypeVar

from fusion.caveats import TERM, name_facts
from fusion.errors import Fact, FusionError


@dataclass(frozen=True, slots=True)
class Outcome:
    """HTTP status, exit code of the command line, and whether trying again may help."""

    status: int
    exit_code: int
    retryable: bool = False


BUG = Outcome(500, 3, retryable=True)
REFUSED_BY_THE_SCIENCE = Outcome(422, 3)
"""Of every :class:`fusion.errors.FusionError`, which knows neither HTTP nor a command line."""

# Codes that no class carries: nothing raises them.
UNREADABLE_PATH = "E-FILE"
NO_RECORDING = "E-NO-RECORDING"
NO_SHARDS = "E-NO-SHARDS"
NO_RESULTS = "E-NO-RESULTS"
CANCELLED = "E-CANCELLED"


class AppError(Exception):
    """``code`` says why and ``facts`` fill the sentence.

    The head of a class declares its code, its outcome (else its parent's) and the facts that it may have,
    each with its unit or meaning.

    Attributes
    ----------
    outcome
        What it comes to, over HTTP and on the command line.
    fact_meanings
        The names that ``facts`` may hold, each with its unit or meaning.
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
    """A refusal that another process met: any code, with its facts."""

    def __init__(self, code: str, facts: Mapping[str, Fact]) -> None:
        super().__init__(code, facts)
        self.code, self.facts = code, facts


class BadParameter(
    AppError,
    code="E-PARAMETER",
    outcome=Outcome(422, 2),
    name="of the value",
    value="as given",
    allowed="what can be",
):
    """A value that cannot be."""


class UnusableSettings(
    AppError,
    code="E-SETTINGS",
    outcome=Outcome(422, 2),
    name="setting",
    why=TERM,
    value="as written",
    allowed="what can be",
    nearest="setting of a like name",
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
    allowed="what can be",
    line="line",
    other="line of a second row",
    first="recording",
    second="recording",
    more="rows not told",
):
    """Rows of a list of participants cannot be used.

    The facts of the second row that cannot be used end in ``_2``, and so on.
    """


class UnusableList(
    AppError, code="E-LIST", outcome=Outcome(422, 2), why=TERM, value="as written", line="line"
):
    """A list of recordings cannot be used."""


class BadChecksum(
    BadParameter, code="E-CHECKSUM", outcome=Outcome(400, 2), value="as given", allowed="what can be"
):
    """No checksum that could be compared."""


class UploadRefused(AppError, code="E-UPLOAD", outcome=Outcome(400, 3, retryable=True)):
    """The bytes were not taken."""


class FileTooLarge(UploadRefused, code="E-BIG", outcome=Outcome(413, 3), n="GB", max="GB"):
    """More bytes than allowed."""


class DiskFull(UploadRefused, code="E-DISK", outcome=Outcome(507, 3, retryable=True), tries="attempts"):
    """Too little space is left to take a recording."""


class SlowUpload(UploadRefused, code="E-SLOW", outcome=Outcome(408, 3, retryable=True)):
    """The bytes came too slowly."""


class BrokenUpload(UploadRefused, code="E-CUT-UPLOAD"):
    """Fewer bytes came than were announced."""


class WrongOffset(UploadRefused, code="E-OFFSET", outcome=Outcome(409, 3, retryable=True), expected="byte"):
    """The bytes do not begin where the upload ended."""


class LockedUpload(UploadRefused, code="E-LOCKED", outcome=Outcome(423, 3, retryable=True)):
    """Another request writes to the same upload."""


class WrongDigest(UploadRefused, code="E-DIGEST", outcome=Outcome(460, 3, retryable=True)):
    """What arrived is not what was sent."""


class WrongLength(UploadRefused, code="E-LENGTH", outcome=Outcome(400, 3)):
    """The length is missing or wrong."""


class WrongMediaType(
    UploadRefused, code="E-MEDIA", outcome=Outcome(415, 3), found="media type", allowed="media types"
):
    """The body is of a kind that is not taken here."""


class UnknownProtocol(UploadRefused, code="E-PROTOCOL", outcome=Outcome(412, 3), allowed="versions"):
    """Another version of the upload protocol."""


class Busy(AppError, code="E-BUSY", outcome=Outcome(503, 3, retryable=True)):
    """More work waits than is allowed."""


class TooMany(AppError, code="E-TOO-MANY", outcome=Outcome(429, 3, retryable=True), max="uploads at once"):
    """As many uploads as are taken at once are under way."""


class TooManySessions(
    AppError, code="E-LIVE-FULL", outcome=Outcome(429, 3, retryable=True), max="sessions at once"
):
    """As many live sessions as one server runs are under way."""


class LiveSourceFailed(
    AppError, code="E-LIVE-SOURCE", outcome=Outcome(422, 3, retryable=True), name="of the port", why=TERM
):
    """No samples come from where they were to come from."""


class PurgedSince(AppError, code="E-PURGED", outcome=Outcome(410, 3)):
    """The recording of this upload has been deleted for good."""


class ForeignWebhook(AppError, code="E-WEBHOOK", outcome=Outcome(422, 2), url="address"):
    """A webhook may not lead there."""


class OnHold(AppError, code="E-HOLD", outcome=Outcome(409, 3), id="of the recording", why=TERM):
    """The recording is on hold: nothing of it may be deleted for good."""


class StaleVersion(AppError, code="E-STALE", outcome=Outcome(409, 3)):
    """Somebody else has changed it meanwhile."""


class NotHere(AppError, code="E-NOT-FOUND", outcome=Outcome(404, 3), id="of what was asked for"):
    """No such page, recording or analysis."""


class NoSuchFile(NotHere, code="E-NO-FILE", name="of the file"):
    """The analysis ended without this file."""


class NoSuchRange(AppError, code="E-RANGE", outcome=Outcome(416, 2), size="bytes"):
    """A part of a file behind its end."""


class CannotPair(AppError, code="E-PAIR", outcome=Outcome(422, 3), why=TERM):
    """Two analyses cannot be set side by side."""


class CannotCompare(AppError, code="E-COMPARE", outcome=Outcome(422, 3), why=TERM):
    """Two analyses are no two days of one person, or of one method."""


class CannotProfile(
    AppError, code="E-DAYS", outcome=Outcome(422, 3), why=TERM, name="file or folder", other="file or folder"
):
    """Analyses that are no days of one person or of one group."""


class NotFinished(AppError, code="E-NOT-FINISHED", outcome=Outcome(409, 3, retryable=True), state=TERM):
    """The analysis has not ended yet."""


class NotAllowed(AppError, code="E-NOT-ALLOWED", outcome=Outcome(403, 2)):
    """Not for this caller."""


class NotSignedIn(NotAllowed, code="E-SIGN-IN", outcome=Outcome(401, 2)):
    """Nobody known: no session, token or secret."""


class NotPermitted(NotAllowed, code="E-PERMISSION", permission=TERM):
    """Known, but without the permission that this asks for."""


class NotConfirmed(NotAllowed, code="E-CONFIRM"):
    """Logged in too long ago for what this asks for: the password is asked for again."""


class LoginRefused(NotAllowed, code="E-LOGIN", outcome=Outcome(401, 2)):
    """The name and what was given with it do not let anybody in; which of the two is not said."""


class SecondFactorLost(NotAllowed, code="E-SECOND-FACTOR", outcome=Outcome(503, 2)):
    """The authenticator's secret cannot be decrypted: the secret of the server is another."""


class TooManyTries(NotAllowed, code="E-TRIES", outcome=Outcome(429, 2, retryable=True), wait_s="s"):
    """Too many wrong tries; the next is looked at after a while."""


class WeakPassword(
    NotAllowed, code="E-PASSWORD", outcome=Outcome(422, 2), weak=TERM, least="characters", most="characters"
):
    """A password that others try first, or that is too short."""


class TicketSpent(NotAllowed, code="E-LINK", outcome=Outcome(410, 2)):
    """An address that works once was opened before, or too late."""


class TokenInAddress(NotAllowed, code="E-TOKEN-ADDRESS", outcome=Outcome(400, 2)):
    """A token stands in the address, where logs and histories keep it."""


class ProviderRefused(NotAllowed, code="E-PROVIDER", outcome=Outcome(401, 2, retryable=True), said=TERM):
    """The identity provider does not answer, or what it says is not to be believed."""


class ForeignOrigin(NotAllowed, code="E-ORIGIN"):
    """Another web site asks for a change."""


class ForeignHostName(NotAllowed, code="E-HOST-NAME", outcome=Outcome(421, 2), host="name"):
    """The request names a host that this server is not."""


class WrongVerb(
    NotAllowed, code="E-METHOD", outcome=Outcome(405, 2), method="of the request", allowed="methods"
):
    """The address does not know this method."""


class ServerRefused(AppError, code="E-SERVER", outcome=Outcome(503, 2)):
    """The server cannot start like this."""


class ForeignAddress(ServerRefused, code="E-HOST", host="address", missing="what keeps strangers out"):
    """An address that others reach, without what it needs: accounts, names of the host, TLS."""


class ExamplePassword(ServerRefused, code="E-EXAMPLE-PASSWORD", name="setting"):
    """A password of the example files, which everybody knows."""


class PortTaken(ServerRefused, code="E-PORT", host="address", port="number"):
    """Another program listens there."""


class FolderTaken(ServerRefused, code="E-FOLDER-IN-USE", folder="path"):
    """Another server works in this data folder."""


class FolderUnusable(ServerRefused, code="E-FOLDER", folder="path", why="by the system"):
    """The data folder cannot be used."""


class FolderReadOnly(FolderUnusable, code="E-FOLDER-READ-ONLY", folder="path"):
    """The data folder is on a disk that can only be read."""


class FolderForbidden(FolderUnusable, code="E-FOLDER-PERMISSION", folder="path"):
    """The user of this process may not write in the data folder."""


class FolderIsFile(FolderUnusable, code="E-FOLDER-FILE", folder="path"):
    """A file stands where the data folder should be."""


class DatabaseDamaged(ServerRefused, code="E-DATABASE-DAMAGED", file="path", why="by the database"):
    """The file of the database is damaged; it is never replaced by itself."""


class DatabaseLocked(ServerRefused, code="E-DATABASE-LOCKED", file="path", pid="process, where known"):
    """Another process holds the database and does not let go."""


class WrongSchema(ServerRefused, code="E-SCHEMA", found="revision", needed="revision"):
    """The tables or a backup are of another version; they are left untouched."""


class StoreMismatch(ServerRefused, code="E-STORE-OTHER", found="store", needed="store"):
    """The database belongs to another folder or bucket."""


class AccountsLost(ServerRefused, code="E-ACCOUNTS-LOST", file="path"):
    """The server of this data folder has accounts, and its database holds none."""


class UnknownRecordings(ServerRefused, code="E-UNKNOWN-RECORDINGS", number="recordings", first="key of one"):
    """The store holds recordings that the database does not know: it is lost, older or foreign."""


class NotEmpty(
    ServerRefused, code="E-NOT-EMPTY", number="rows or files", where="table, or file in the store"
):
    """A backup is restored only where nothing is."""


class BackupRefused(ServerRefused, code="E-BACKUP", why="by the system"):
    """The backup cannot be written or read as it is."""


class NotInstalled(ServerRefused, code="E-NOT-INSTALLED", name="of the package", extra="of Acromion"):
    """What a setting needs is not installed."""


class StoreAway(AppError, code="E-STORE", outcome=Outcome(503, 3, retryable=True)):
    """The bucket does not answer."""


class StoreDamaged(AppError, code="E-STORE-DAMAGED", outcome=Outcome(410, 3)):
    """The stored bytes are no longer those that came."""


class PurgeUnfinished(
    AppError, code="E-PURGE-UNFINISHED", outcome=Outcome(503, 3), id="of the recording", why="by the system"
):
    """A recording is hidden, but its rows are still in the database: its copies could not be renewed."""


class SecretUnreadable(AppError, code="E-SECRET", outcome=Outcome(503, 3), file="path"):
    """The secret of this server is gone, or is not the one that encrypted a second factor or a webhook."""


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
    """A file of a finished analysis is missing or not what was made."""


class DatabaseAway(
    AppError, code="E-DATABASE", outcome=Outcome(503, 3, retryable=True), why="by the system, at a start"
):
    """The database does not answer."""


class AttemptFailed(AppError, code="E-STOPPED", outcome=Outcome(500, 3)):
    """The analysis was stopped."""


class Interrupted(
    AttemptFailed,
    code="E-INTERRUPTED",
    outcome=Outcome(503, 130, retryable=True),
    times="interruptions, on a server",
):
    """The computer or the program ended before this recording was done."""


class Crashed(AttemptFailed, code="E-CRASHED", outcome=Outcome(422, 3, retryable=True), attempts="attempts"):
    """The analysis died as often as is allowed, while its worker lived."""


class OutOfMemory(AttemptFailed, code="E-MEMORY", outcome=Outcome(422, 3), max="GB"):
    """The analysis needs more memory than allowed."""


class OutOfTime(AttemptFailed, code="E-TIMEOUT", outcome=Outcome(422, 3), s="s"):
    """The analysis takes longer than allowed."""


class InternalError(AttemptFailed, code="E-INTERNAL", outcome=BUG, reference="in the log"):
    """A bug; the traceback is in the log under this reference."""


@dataclass(frozen=True, slots=True)
class StudyProblem:
    """What could not be compared, and why."""

    name: str
    code: str
    facts: Mapping[str, Fact] = field(default_factory=dict)


Refusal = TypeVar("Refusal", bound=Exception)


def find_outcome(error: type[Exception]) -> Outcome:
    """Return the outcome of a class of errors; an error that is not a refusal is a bug."""
    if issubclass(error, AppError):
        return error.outcome
    return REFUSED_BY_THE_SCIENCE if issubclass(error, FusionError) else BUG


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
