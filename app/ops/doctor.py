"""Doctor: check this machine for problems that would disturb Acromion."""

import os
import shutil
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import closing, suppress
from dataclasses import dataclass, field
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Literal

from sqlalchemy import text
from sqlalchemy.exc import SQLAlchemyError

from acromion.app.accounts.accounts import AccountStore
from acromion.app.errors import AccountsLost, AppError
from acromion.app.library.database.connect import check_whole, connect, open_database, translate_start_errors
from acromion.app.library.jobs import JobStore
from acromion.app.ops.copies import find_newest_backup
from acromion.app.ops.place import find_unreadable, is_used
from acromion.app.ops.recover import find_strange, find_unknown
from acromion.app.ops.verify import find_expected, find_faults, measure_expected
from acromion.app.report.render.html import find_template_folder
from acromion.app.settings import Settings
from acromion.app.store.folder import open_storage
from acromion.app.store.permissions import make_folder
from acromion.app.store.server_secret import ServerSecret
from acromion.fusion.numba_kernels import make_kernel_folder

OLDEST_CLOCK = datetime(2025, 1, 1, tzinfo=UTC)
CLOCK_SKEW_S = 30.0
GIB = 1 << 30
MOST_READ_BYTES = 8 * GIB
"""Reading a larger store would take more than about half a minute."""


OLDEST_BACKUP = timedelta(days=2)
State = Literal["good", "warning", "bad"]
"""``warning``: it works, but something needs attention or was not checked."""


@dataclass(frozen=True, slots=True)
class Examination:
    """The result of one check: its name (a key of the wording), its state, and facts."""

    name: str
    state: State
    facts: Mapping[str, str] = field(default_factory=dict)


def examine(settings: Settings) -> Iterator[Examination]:
    """Run every check independently; on an unused installation only report that, and create nothing."""
    if not _is_used(settings):
        yield Examination("unused", state="bad", facts={"folder": str(settings.data_dir.resolve())})
        return
    yield _examine_folder(settings)
    yield _examine_disk(settings)
    yield _examine_database(settings)
    yield _examine_store(settings)
    for name, check in (
        ("accounts", _find_lost_accounts),
        ("secret", _find_lost_secret),
        ("recordings", _find_unknown_recordings),
        ("quarantine", _find_quarantined),
        ("bytes", _find_damaged),
    ):
        yield _examine_kept(settings, name, check)
    yield _examine_backups(settings)
    yield _examine_cache()
    yield _examine_fonts()
    yield _examine_clock(settings)
    yield _examine_memory(settings)


def _is_used(settings: Settings) -> bool:
    try:
        with translate_start_errors(settings):
            return is_used(settings)
    except (AppError, SQLAlchemyError, OSError):
        return True  # folder and database have separate checks


def _examine_folder(settings: Settings) -> Examination:
    """Check that the folder is writable by us alone."""
    folder = settings.data_dir
    facts = {"folder": str(folder.resolve())}
    try:
        make_folder(folder)
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError as error:
        return Examination("folder", state="bad", facts=facts | {"why": error.strerror or ""})
    if sys.platform != "win32" and folder.stat().st_mode & 0o007:
        return Examination("folder_open", state="bad", facts=facts)
    return Examination("folder", state="good", facts=facts)


def _examine_disk(settings: Settings) -> Examination:
    free_bytes = shutil.disk_usage(_find_existing(settings.data_dir)).free
    facts = {"free": f"{free_bytes / GIB:.1f}", "needed": f"{settings.min_free_bytes / GIB:.1f}"}
    return _judge("disk", free_bytes >= settings.min_free_bytes, facts)


def _examine_database(settings: Settings) -> Examination:
    """Check that the database responds and has our tables."""
    try:
        with translate_start_errors(settings):
            check_whole(settings.database_url)
            engine = open_database(settings.database_url)
            engine.dispose()
    except AppError as refusal:
        return Examination("database", state="bad", facts={"why": refusal.code})
    except SQLAlchemyError as error:
        return Examination("database", state="bad", facts={"why": type(error).__name__})
    return Examination("database", state="good", facts={"kind": engine.dialect.name})


def _examine_store(settings: Settings) -> Examination:
    facts = {"where": settings.object_store or str(settings.data_dir)}
    try:
        storage = open_storage(settings)
        storage.prepare()
        storage.identify()
    except AppError as refusal:
        return Examination("store", state="bad", facts=facts | {"why": refusal.code})
    except OSError as error:
        return Examination("store", state="bad", facts=facts | {"why": error.strerror or ""})
    return Examination("store", state="good", facts=facts)


def _examine_kept(
    settings: Settings, name: str, find: Callable[[Settings], Mapping[str, str] | None]
) -> Examination:
    """Check what is stored: ``find`` returns the facts of a fault, {} for none, None if it did not look."""
    try:
        wrong = find(settings)
    except (AppError, SQLAlchemyError, OSError) as error:  # the checks of database and store say why
        return Examination("unread", "warning", {"name": name, "why": type(error).__name__})
    if wrong is None:
        return Examination(f"{name}_unread", "warning")
    return Examination(name, "bad" if wrong else "good", wrong)


def _find_lost_accounts(settings: Settings) -> Mapping[str, str]:
    """Return facts if the database has no account although the folder was marked as having some."""
    try:
        AccountStore(settings).check_kept()
    except AccountsLost as lost:
        return {"file": str(lost.facts["file"])}
    return {}


def _find_lost_secret(settings: Settings) -> Mapping[str, str]:
    """Return facts if second factors or webhooks were encrypted with another server secret."""
    secret = ServerSecret(settings.data_dir)
    with closing(JobStore(settings)) as store:
        lost = find_unreadable(store.reader, secret)
    if not lost.second_factors and not lost.webhooks:
        return {}
    counts = {"factors": str(lost.second_factors), "webhooks": str(lost.webhooks)}
    return counts | {"file": str(secret.file)}


def _find_unknown_recordings(settings: Settings) -> Mapping[str, str]:
    with closing(JobStore(settings)) as store:
        unknown = find_unknown(store, open_storage(settings)).recoverable
    return {"number": str(len(unknown))} if unknown else {}


def _find_quarantined(settings: Settings) -> Mapping[str, str]:
    names = find_strange(open_storage(settings))
    folder = str(settings.data_dir.resolve() / "quarantine")
    return {"number": str(len(names)), "first": names[0], "folder": folder} if names else {}


def _find_damaged(settings: Settings) -> Mapping[str, str] | None:
    """Find stored files that differ from their rows; leave a large store to ``acromion verify``."""
    files = find_expected(settings)
    if measure_expected(settings) > MOST_READ_BYTES:
        return None
    faults = [one.name for one in find_faults(settings, files) if one.finding in ("missing", "damaged")]
    return {"number": str(len(faults)), "first": faults[0]} if faults else {}


def _examine_backups(settings: Settings) -> Examination:
    """Check that a backup was made in the last two days; one from the future has an unknown age."""
    try:
        made_at = find_newest_backup(open_storage(settings))
    except (AppError, OSError) as error:
        return Examination("unread", "warning", {"name": "backup", "why": type(error).__name__})
    if made_at is None:
        return Examination("no_backup", "warning")
    age = datetime.now(UTC) - made_at
    return Examination(
        "backup",
        "warning" if abs(age) > OLDEST_BACKUP else "good",
        {"days": f"{age.total_seconds() / 86400:.1f}"},
    )


def _examine_cache() -> Examination:
    """Check that compiled code can be cached; otherwise each start compiles it again."""
    folder = make_kernel_folder() or Path(tempfile.gettempdir())
    writable = os.access(_find_existing(folder), os.W_OK)
    return _judge("cache", writable, {"folder": str(folder)})


def _examine_fonts() -> Examination:
    fonts = [path for path in (find_template_folder() / "fonts").glob("*") if path.suffix in (".ttf", ".otf")]
    return _judge("fonts", bool(fonts), {"number": str(len(fonts))})


def _examine_clock(settings: Settings) -> Examination:
    """Check that the clock is plausible and agrees with the clock of a PostgreSQL server."""
    now, skew_s = datetime.now(UTC), 0.0
    if not settings.database_url.startswith("sqlite"):
        with suppress(SQLAlchemyError):  # the database check reports an unreachable database
            engine = connect(settings.database_url)
            with engine.connect() as connection:
                theirs_s = connection.execute(text("SELECT extract(epoch FROM clock_timestamp())"))
                skew_s = time.time() - float(theirs_s.scalar_one())
            engine.dispose()
    facts = {"clock": now.isoformat(timespec="seconds"), "skew": f"{skew_s:.0f}"}
    return _judge("clock", now > OLDEST_CLOCK and abs(skew_s) < CLOCK_SKEW_S, facts)


def _examine_memory(settings: Settings) -> Examination:
    """Check that each worker has memory for one analysis (700 MiB at most)."""
    if not hasattr(os, "sysconf"):
        return Examination("memory", state="good", facts={"installed": "?"})
    installed_bytes = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    facts = {"installed": f"{installed_bytes / GIB:.1f}"}
    return _judge("memory", installed_bytes > settings.workers * GIB, facts)


def _judge(name: str, is_good: bool, facts: Mapping[str, str]) -> Examination:  # noqa: FBT001
    return Examination(name, "good" if is_good else "bad", facts)


def _find_existing(folder: Path) -> Path:
    """Return the folder, or the nearest existing one above it."""
    return next(place for place in (folder.resolve(), *folder.resolve().parents) if place.exists())
