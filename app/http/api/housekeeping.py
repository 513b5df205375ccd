"""Background work of the server: deliver webhooks and apply retention periods.

Ages are counted in running time of the server, so a wrong system clock deletes nothing.
"""

import asyncio
import logging
import math
import time
from contextlib import suppress

import anyio
from sqlalchemy.exc import OperationalError, SQLAlchemyError

from acromion.app.errors import AppError, LockedUpload, OnHold
from acromion.app.http.api.library.analyses import run_to_end
from acromion.app.http.api.library.recordings import finish_purge, forget_samples, purge_recording
from acromion.app.http.api.library.uploads import drop_upload
from acromion.app.http.api.webhooks import WebhookSender
from acromion.app.library.audit_log import Act, AuditFilter, find_lines, record_alone
from acromion.app.ops.copies import keep_daily_copy, renew_copies
from acromion.app.ops.recover import (
    check_known,
    drop_stale_attempts,
    find_strange,
    finish_purges,
    quarantine_strange,
    restore_known,
    update_side_files,
)
from acromion.app.queue.leader import Leader
from acromion.app.services import Services
from acromion.app.store.folder import TEMPORARY_S
from acromion.app.store.reserve import keep_reserve

CHECK_PERIOD_S = 1.0
SIDE_FILES_AT_ONCE = 200
AGE_S = 60.0
INCOMING_S = 24 * 3600.0
"""Upload bytes without a row are deleted after this time; no client can resume them."""

logger = logging.getLogger(__name__)


async def run_housekeeping(services: Services) -> None:
    """Run the background work until the server ends; of several servers, only the leader does it."""
    leader, sender = Leader(services.store.engine), WebhookSender(services)
    await _note(services, "server.started")
    looked_s = aged_s = time.monotonic()
    try:
        while True:
            await anyio.sleep(CHECK_PERIOD_S)
            now_s = time.monotonic()
            try:
                await run_to_end(keep_reserve, services.storage.root)
                if not await run_to_end(leader.is_leader):
                    looked_s = aged_s = now_s  # the leader counts this time
                    continue
                await run_to_end(write_side_files, services)
                await sender.start_due(now_s - looked_s)
                looked_s = now_s
                if now_s - aged_s > AGE_S:
                    await run_to_end(apply_retention, services, now_s - aged_s)
                    aged_s = now_s
                    await run_to_end(keep_daily_copy, services.settings, services.store.engine)
            except OperationalError:
                logger.exception("the database does not answer; trying again")
            except (AppError, OSError):
                logger.exception("housekeeping failed; trying again")
    finally:
        await sender.stop()
        leader.close()
        await asyncio.shield(_note(services, "server.stopped"))


async def _note(services: Services, act: Act) -> None:
    """Write an audit log entry about the server; a failure does not stop the server."""
    try:
        await run_to_end(record_alone, services.store.engine, act)
    except SQLAlchemyError:
        logger.exception("the audit log cannot be written")


def write_side_files(services: Services) -> None:
    """Write the side files of changed recordings; a failure is only logged: the rows are committed."""
    try:
        while services.side_files.write_lagging(SIDE_FILES_AT_ONCE) == SIDE_FILES_AT_ONCE:
            continue
    except (AppError, OSError, SQLAlchemyError):
        logger.exception("side files could not be written; trying again")


def reconcile(services: Services) -> None:
    """Compare files and rows at the start; unknown files are never deleted.

    Raises UnknownRecordings.
    """
    store, storage, uploads = services.store, services.storage, services.uploads
    unknown = check_known(store, storage)
    begun = storage.find_erased() & store.find_recordings()
    for recording_id in {*services.recordings.find_purging(), *begun}:
        try:
            purge_recording(services, recording_id)
        except (AppError, OSError):
            logger.exception("the purge of %s failed; the next start tries again", recording_id)
    finish_purges(storage, unknown)
    attempts, newer = drop_stale_attempts(store, storage)
    back, moved = restore_known(store, storage), quarantine_strange(storage, unknown)
    dropped, swept = _finish_dropped(services), 0
    for upload_id in services.incoming.find_stale(uploads.find_growing(), uploads.find_known(), INCOMING_S):
        swept += services.incoming.sweep(upload_id)
    swept += storage.drop_temporary(TEMPORARY_S)
    written = update_side_files(store, storage)
    services.quarantined = find_strange(storage)
    counts = {
        "recordings restored from quarantine: they have rows": back,
        "unknown entries moved into quarantine": moved,
        "stale attempts removed": attempts,
        "expired results removed": dropped,
        "old temporary files removed": swept,
        "reports are newer than the database: stop, and run acromion recover": newer,
        "side files written": written,
        "entries in quarantine: acromion doctor": len(services.quarantined),
    }
    for what, number in counts.items():
        if number:
            logger.warning("start: %d %s", number, what)


def _finish_dropped(services: Services) -> int:
    """Remove the files of results whose rows retention deleted before a crash; return their number."""
    there = {analysis_id for analysis_id, _ in services.storage.find_attempts()}
    strays = there - services.store.find_analyses()
    if not strays:
        return 0
    lines = find_lines(services.store.reader, AuditFilter(act="analysis.purged"))
    dropped = strays & {line.analysis_id for line in lines}
    for analysis_id in dropped:
        services.storage.drop_analysis(analysis_id)
    return len(dropped)


def apply_retention(services: Services, elapsed_s: float) -> None:
    """Age uploads and trash by ``elapsed_s``; delete everything that has expired."""
    settings = services.settings
    for upload_id in services.uploads.age(elapsed_s, settings.upload_term_s):
        try:
            drop_upload(services, services.uploads.get(upload_id))
        except LockedUpload:
            continue
    services.retention.add_running_time(elapsed_s)
    trash_term_s = services.retention.find_trash_term_s(settings.trash_term_s)
    if services.retention.is_in_grace("trash"):
        trash_term_s = math.inf
    due = services.recordings.advance_trash(elapsed_s, trash_term_s)
    begun = []
    for recording_id in (
        *services.recordings.find_purging(),
        *due,
        *services.retention.find_due_recordings(),
    ):
        with suppress(OnHold):  # put on hold meanwhile
            begun.append(services.recordings.begin_purge(recording_id))
    finish_purge(services, *begun)
    dropped = [one for one in services.retention.find_due_results() if services.retention.drop_analysis(one)]
    for analysis_id in dropped:
        services.storage.drop_analysis(analysis_id)
    if dropped:
        renew_copies(settings, services.store.engine)
    services.retention.shorten_audit_log()
    forget_samples(services)  # a child process may have written samples during the purge
    services.recordings.forget_purged()
    services.storage.drop_temporary(TEMPORARY_S)
    services.quarantined = find_strange(services.storage)
