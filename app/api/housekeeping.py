"""What the server does by itself: tells webhooks, and forgets what is old.

Old is counted in time that the server has run, not by the clock: a clock that is put forward deletes nothing.
"""

import logging
import time

import anyio
from sqlalchemy.exc import OperationalError

from app.api.recordings import purge_recording
from app.api.services import Services
from app.api.tus_body import drop_upload
from app.api.waiting import run_to_end
from app.delivery import Message, send_message
from app.errors import LockedUpload
from app.jobs.keeper import Keeper

LOOK_S = 1.0
AGE_S = 60.0
ANSWER_TERM_S = 24 * 3600.0

logger = logging.getLogger(__name__)


async def keep_house(services: Services) -> None:
    """Look after the server until it ends; where several serve, one of them does for all."""
    keeper = Keeper(services.store.engine)
    try:
        await _keep_on(services, keeper)
    finally:
        keeper.close()


async def _keep_on(services: Services, keeper: Keeper) -> None:
    looked_s = aged_s = time.monotonic()
    while True:
        await anyio.sleep(LOOK_S)
        now_s = time.monotonic()
        try:
            if not await run_to_end(keeper.holds_office):
                looked_s = aged_s = now_s  # another counts this time
                continue
            await run_to_end(tell_webhooks, services, now_s - looked_s)
            looked_s = now_s
            if now_s - aged_s > AGE_S:
                await run_to_end(grow_older, services, now_s - aged_s)
                aged_s = now_s
        except OperationalError:
            logger.exception("the database does not answer; trying again")


def tell_webhooks(services: Services, elapsed_s: float) -> None:
    """Tell what is due; what is not heard is tried again later.

    An address that does not hear is tried once in a round: it must not keep the others waiting.
    """
    deaf: set[str] = set()
    for delivery in services.webhooks.wait(elapsed_s):
        if delivery.url in deaf or not services.webhooks.take(delivery):
            continue
        message = Message(delivery.id, delivery.url, delivery.secret, delivery.body)
        if send_message(message, allow_private=services.settings.webhooks_may_be_private):
            services.webhooks.told(delivery)
        else:
            deaf.add(delivery.url)


def grow_older(services: Services, elapsed_s: float) -> None:
    """Let time pass for uploads, trash and kept answers; delete what has come to its term."""
    settings = services.settings
    for upload_id in services.uploads.age(elapsed_s, settings.upload_term_s):
        try:
            drop_upload(services, services.uploads.get(upload_id))
        except LockedUpload:
            continue
    for recording_id in services.recordings.age_trash(elapsed_s, settings.trash_term_s):
        purge_recording(services, recording_id)
    services.answers.age(elapsed_s, ANSWER_TERM_S)
