"""What can go wrong around the science, each class with its code, its facts and what it comes to.

As in :mod:`fusion.errors`, a class has a code and facts, never a sentence. A class without an outcome of its
own has its parent's.
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

    Attributes
    ----------
    outcome
        What it comes to, over HTTP and on the command line.
    fact_meanings
        The names that ``facts`` may hold, each with its unit or meaning.
    """

    code: ClassVar[str]
    outcome: ClassVar[Outcome] = BUG
    fact_meanings = name_facts()

    def __init__(self, **facts: Fact) -> None:
        super().__init__(self.code, facts)
        self.facts = facts


class RecordedProblem(Exception):
    """A refusal that another process met: any code, with its facts."""

    def __init__(self, code: str, facts: Mapping[str, Fact]) -> None:
        super().__init__(code, facts)
        self.code, self.facts = code, facts


class BadParameter(AppError):
    """A value that cannot be."""

    code = "E-PARAMETER"
    outcome = Outcome(422, 2)
    fact_meanings = name_facts(name="of the value", value="as given", allowed="what can be")


class UnusableSettings(AppError):
    """A settings file cannot be used."""

    code = "E-SETTINGS"
    outcome = Outcome(422, 2)
    fact_meanings = name_facts(
        name="setting",
        why=TERM,
        value="as written",
        allowed="what can be",
        nearest="setting of a like name",
        line="line",
    )


class UnusableParticipants(AppError):
    """Rows of a list of participants cannot be used.

    The facts of the second row that cannot be used end in ``_2``, and so on.
    """

    code = "E-PARTICIPANTS"
    outcome = Outcome(422, 2)
    fact_meanings = name_facts(
        why=TERM,
        cure=TERM,
        value="as written",
        allowed="what can be",
        line="line",
        other="line of a second row",
        first="recording",
        second="recording",
        more="rows not told",
    )


class UnusableList(AppError):
    """A list of recordings cannot be used."""

    code = "E-LIST"
    outcome = Outcome(422, 2)
    fact_meanings = name_facts(why=TERM, value="as written", line="line")


class BadChecksum(BadParameter):
    """No checksum that could be compared."""

    code = "E-CHECKSUM"
    outcome = Outcome(400, 2)
    fact_meanings = name_facts(value="as given", allowed="what can be")


class UploadRefused(AppError):
    """The bytes were not taken."""

    code = "E-UPLOAD"
    outcome = Outcome(400, 3, retryable=True)


class FileTooLarge(UploadRefused):
    """More bytes than allowed."""

    code = "E-BIG"
    outcome = Outcome(413, 3)
    fact_meanings = name_facts(n="GB", max="GB")


class DiskFull(UploadRefused):
    """Too little space is left to take a recording."""

    code = "E-DISK"
    outcome = Outcome(507, 3, retryable=True)
    fact_meanings = name_facts(tries="attempts")


class SlowUpload(UploadRefused):
    """The bytes came too slowly."""

    code = "E-SLOW"
    outcome = Outcome(408, 3, retryable=True)


class BrokenUpload(UploadRefused):
    """Fewer bytes came than were announced."""

    code = "E-CUT-UPLOAD"


class WrongOffset(UploadRefused):
    """The bytes do not begin where the upload ended."""

    code = "E-OFFSET"
    outcome = Outcome(409, 3, retryable=True)
    fact_meanings = name_facts(expected="byte")


class LockedUpload(UploadRefused):
    """Another request writes to the same upload."""

    code = "E-LOCKED"
    outcome = Outcome(423, 3, retryable=True)


class WrongDigest(UploadRefused):
    """What arrived is not what was sent."""

    code = "E-DIGEST"
    outcome = Outcome(460, 3, retryable=True)


class WrongLength(UploadRefused):
    """The length is missing or wrong."""

    code = "E-LENGTH"
    outcome = Outcome(400, 3)


class WrongMediaType(UploadRefused):
    """The body is of a kind that is not taken here."""

    code = "E-MEDIA"
    outcome = Outcome(415, 3)
    fact_meanings = name_facts(found="media type", allowed="media types")


class UnknownProtocol(UploadRefused):
    """Another version of the upload protocol."""

    code = "E-PROTOCOL"
    outcome = Outcome(412, 3)
    fact_meanings = name_facts(allowed="versions")


class Busy(AppError):
    """More work waits than is allowed."""

    code = "E-BUSY"
    outcome = Outcome(503, 3, retryable=True)


class TooMany(AppError):
    """As many uploads as are taken at once are under way."""

    code = "E-TOO-MANY"
    outcome = Outcome(429, 3, retryable=True)
    fact_meanings = name_facts(max="uploads at once")


class TooManySessions(AppError):
    """As many live sessions as one server runs are under way."""

    code = "E-LIVE-FULL"
    outcome = Outcome(429, 3, retryable=True)
    fact_meanings = name_facts(max="sessions at once")


class LiveSourceFailed(AppError):
    """No samples come from where they were to come from."""

    code = "E-LIVE-SOURCE"
    outcome = Outcome(422, 3, retryable=True)
    fact_meanings = name_facts(name="of the port", why=TERM)


class PurgedSince(AppError):
    """The recording of this upload has been deleted for good."""

    code = "E-PURGED"
    outcome = Outcome(410, 3)


class ForeignWebhook(AppError):
    """A webhook may not lead there."""

    code = "E-WEBHOOK"
    outcome = Outcome(422, 2)
    fact_meanings = name_facts(url="address")


class OnHold(AppError):
    """The recording is on hold: nothing of it may be deleted for good."""

    code = "E-HOLD"
    outcome = Outcome(409, 3)
    fact_meanings = name_facts(id="of the recording", why=TERM)


class StaleVersion(AppError):
    """Somebody else has changed it meanwhile."""

    code = "E-STALE"
    outcome = Outcome(409, 3)


class NotHere(AppError):
    """No such page, recording or analysis."""

    code = "E-NOT-FOUND"
    outcome = Outcome(404, 3)
    fact_meanings = name_facts(id="of what was asked for")


class NoSuchFile(NotHere):
    """The analysis ended without this file."""

    code = "E-NO-FILE"
    fact_meanings = name_facts(name="of the file")


class NoSuchRange(AppError):
    """A part of a file behind its end."""

    code = "E-RANGE"
    outcome = Outcome(416, 2)
    fact_meanings = name_facts(size="bytes")


class CannotPair(AppError):
    """Two analyses cannot be set side by side."""

    code = "E-PAIR"
    outcome = Outcome(422, 3)
    fact_meanings = name_facts(why=TERM)


class CannotCompare(AppError):
    """Two analyses are no two days of one person, or of one method."""

    code = "E-COMPARE"
    outcome = Outcome(422, 3)
    fact_meanings = name_facts(why=TERM)


class CannotProfile(AppError):
    """Analyses that are no days of one person or of one group."""

    code = "E-DAYS"
    outcome = Outcome(422, 3)
    fact_meanings = name_facts(why=TERM, name="file or folder", other="file or folder")


class NotFinished(AppError):
    """The analysis has not ended yet."""

    code = "E-NOT-FINISHED"
    outcome = Outcome(409, 3, retryable=True)
    fact_meanings = name_facts(state=TERM)


class NotAllowed(AppError):
    """Not for this caller."""

    code = "E-NOT-ALLOWED"
    outcome = Outcome(403, 2)


class NotSignedIn(NotAllowed):
    """Nobody known: no session, token or secret."""

    code = "E-SIGN-IN"
    outcome = Outcome(401, 2)


class NotPermitted(NotAllowed):
    """Known, but without the permission that this asks for."""

    code = "E-PERMISSION"
    fact_meanings = name_facts(permission=TERM)


class NotConfirmed(NotAllowed):
    """Logged in too long ago for what this asks for: the password is asked for again."""

    code = "E-CONFIRM"


class LoginRefused(NotAllowed):
    """The name and what was given with it do not let anybody in; which of the two is not said."""

    code = "E-LOGIN"
    outcome = Outcome(401, 2)


class SecondFactorLost(NotAllowed):
    """The authenticator's secret cannot be decrypted: the secret of the server is another."""

    code = "E-SECOND-FACTOR"
    outcome = Outcome(503, 2)


class TooManyTries(NotAllowed):
    """Too many wrong tries; the next is looked at after a while."""

    code = "E-TRIES"
    outcome = Outcome(429, 2, retryable=True)
    fact_meanings = name_facts(wait_s="s")


class WeakPassword(NotAllowed):
    """A password that others try first, or that is too short."""

    code = "E-PASSWORD"
    outcome = Outcome(422, 2)
    fact_meanings = name_facts(weak=TERM, least="characters", most="characters")


class TicketSpent(NotAllowed):
    """An address that works once was opened before, or too late."""

    code = "E-LINK"
    outcome = Outcome(410, 2)


class TokenInAddress(NotAllowed):
    """A token stands in the address, where logs and histories keep it."""

    code = "E-TOKEN-ADDRESS"
    outcome = Outcome(400, 2)


class ProviderRefused(NotAllowed):
    """The identity provider does not answer, or what it says is not to be believed."""

    code = "E-PROVIDER"
    outcome = Outcome(401, 2, retryable=True)
    fact_meanings = name_facts(said=TERM)


class ForeignOrigin(NotAllowed):
    """Another web site asks for a change."""

    code = "E-ORIGIN"


class ForeignHostName(NotAllowed):
    """The request names a host that this server is not."""

    code = "E-HOST-NAME"
    outcome = Outcome(421, 2)
    fact_meanings = name_facts(host="name")


class WrongVerb(NotAllowed):
    """The address does not know this method."""

    code = "E-METHOD"
    outcome = Outcome(405, 2)
    fact_meanings = name_facts(method="of the request", allowed="methods")


class ServerRefused(AppError):
    """The server cannot start like this."""

    code = "E-SERVER"
    outcome = Outcome(503, 2)


class ForeignAddress(ServerRefused):
    """An address that others reach, without what it needs: accounts, names of the host, TLS."""

    code = "E-HOST"
    fact_meanings = name_facts(host="address", missing="what keeps strangers out")


class ExamplePassword(ServerRefused):
    """A password of the example files, which everybody knows."""

    code = "E-EXAMPLE-PASSWORD"
    fact_meanings = name_facts(name="setting")


class PortTaken(ServerRefused):
    """Another program listens there."""

    code = "E-PORT"
    fact_meanings = name_facts(host="address", port="number")


class FolderTaken(ServerRefused):
    """Another server works in this data folder."""

    code = "E-FOLDER-IN-USE"
    fact_meanings = name_facts(folder="path")


class FolderUnusable(ServerRefused):
    """The data folder cannot be used."""

    code = "E-FOLDER"
    fact_meanings = name_facts(folder="path", why="by the system")


class FolderReadOnly(FolderUnusable):
    """The data folder is on a disk that can only be read."""

    code = "E-FOLDER-READ-ONLY"
    fact_meanings = name_facts(folder="path")


class FolderForbidden(FolderUnusable):
    """The user of this process may not write in the data folder."""

    code = "E-FOLDER-PERMISSION"
    fact_meanings = name_facts(folder="path")


class FolderIsFile(FolderUnusable):
    """A file stands where the data folder should be."""

    code = "E-FOLDER-FILE"
    fact_meanings = name_facts(folder="path")


class DatabaseDamaged(ServerRefused):
    """The file of the database is damaged; it is never replaced by itself."""

    code = "E-DATABASE-DAMAGED"
    fact_meanings = name_facts(file="path", why="by the database")


class DatabaseLocked(ServerRefused):
    """Another process holds the database and does not let go."""

    code = "E-DATABASE-LOCKED"
    fact_meanings = name_facts(file="path", pid="process, where known")


class WrongSchema(ServerRefused):
    """The tables or a backup are of another version; they are left untouched."""

    code = "E-SCHEMA"
    fact_meanings = name_facts(found="revision", needed="revision")


class StoreMismatch(ServerRefused):
    """The database belongs to another folder or bucket."""

    code = "E-STORE-OTHER"
    fact_meanings = name_facts(found="store", needed="store")


class AccountsLost(ServerRefused):
    """The server of this data folder has accounts, and its database holds none."""

    code = "E-ACCOUNTS-LOST"
    fact_meanings = name_facts(file="path")


class UnknownRecordings(ServerRefused):
    """The store holds recordings that the database does not know: it is lost, older or foreign."""

    code = "E-UNKNOWN-RECORDINGS"
    fact_meanings = name_facts(number="recordings", first="key of one")


class NotEmpty(ServerRefused):
    """A backup is restored only where nothing is."""

    code = "E-NOT-EMPTY"
    fact_meanings = name_facts(number="rows or files", where="table, or file in the store")


class BackupRefused(ServerRefused):
    """The backup cannot be written or read as it is."""

    code = "E-BACKUP"
    fact_meanings = name_facts(why="by the system")


class NotInstalled(ServerRefused):
    """What a setting needs is not installed."""

    code = "E-NOT-INSTALLED"
    fact_meanings = name_facts(name="of the package", extra="of Acromion")


class StoreAway(AppError):
    """The bucket does not answer."""

    code = "E-STORE"
    outcome = Outcome(503, 3, retryable=True)


class StoreDamaged(AppError):
    """The stored bytes are no longer those that came."""

    code = "E-STORE-DAMAGED"
    outcome = Outcome(410, 3)


class PurgeUnfinished(AppError):
    """A recording is hidden, but its rows are still in the database: its copies could not be renewed."""

    code = "E-PURGE-UNFINISHED"
    outcome = Outcome(503, 3)
    fact_meanings = name_facts(id="of the recording", why="by the system")


class SecretUnreadable(AppError):
    """The secret of this server is gone, or is not the one that encrypted a second factor or a webhook."""

    code = "E-SECRET"
    outcome = Outcome(503, 3)
    fact_meanings = name_facts(file="path")


class ResultDamaged(AppError):
    """A file of a finished analysis is missing or not what was made."""

    code = "E-RESULT-DAMAGED"
    outcome = Outcome(410, 3, retryable=True)
    fact_meanings = name_facts(
        name="of the file", analysis="identity", again="identity of the analysis that replaces it"
    )


class DatabaseAway(AppError):
    """The database does not answer."""

    code = "E-DATABASE"
    outcome = Outcome(503, 3, retryable=True)
    fact_meanings = name_facts(why="by the system, at a start")


class AttemptFailed(AppError):
    """The analysis was stopped."""

    code = "E-STOPPED"
    outcome = Outcome(500, 3)


class Interrupted(AttemptFailed):
    """The computer or the program ended before this recording was done."""

    code = "E-INTERRUPTED"
    outcome = Outcome(503, 130, retryable=True)
    fact_meanings = name_facts(times="interruptions, on a server")


class Crashed(AttemptFailed):
    """The analysis died as often as is allowed, while its worker lived."""

    code = "E-CRASHED"
    outcome = Outcome(422, 3, retryable=True)
    fact_meanings = name_facts(attempts="attempts")


class OutOfMemory(AttemptFailed):
    """The analysis needs more memory than allowed."""

    code = "E-MEMORY"
    outcome = Outcome(422, 3)
    fact_meanings = name_facts(max="GB")


class OutOfTime(AttemptFailed):
    """The analysis takes longer than allowed."""

    code = "E-TIMEOUT"
    outcome = Outcome(422, 3)
    fact_meanings = name_facts(s="s")


class InternalError(AttemptFailed):
    """A bug; the traceback is in the log under this reference."""

    code = "E-INTERNAL"
    outcome = BUG
    fact_meanings = name_facts(reference="in the log")


@dataclass(frozen=True, slots=True)
class StudyProblem:
    """What could not be compared, and why."""

    name: str
    code: str
    facts: Mapping[str, Fact] = field(default_factory=dict)


Refusal = TypeVar("Refusal", bound=Exception)


def find_outcome(error: type[Exception]) -> Outcome:
    """Give what a class of error comes to; any that is not a refusal is a bug."""
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
