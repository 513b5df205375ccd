"""Webhooks: addresses that are notified when an analysis or a batch ends, and their pending deliveries.

A delivery is a row, written in the same commit as the end that it reports, so that no crash loses one.
"""

import base64
import json
import secrets
from dataclasses import dataclass
from typing import Literal, get_args

from sqlalchemy import Connection, delete, func, insert, select, update

from acromion.app.errors import NotHere
from acromion.app.library.audit_log import record
from acromion.app.library.database.tables import analyses, batch_items, batches, deliveries, webhooks
from acromion.app.library.rows import JobState, RowStore, format_now, select_items
from acromion.app.store.server_secret import ServerSecret

SECRET_OF_WEBHOOK = "webhook"  # noqa: S105 - the purpose, for its encryption
Event = Literal["analysis.finished", "batch.finished", "live.cue"]
EVENTS: tuple[Event, ...] = get_args(Event)
USUAL_EVENTS: tuple[Event, ...] = ("analysis.finished", "batch.finished")
"""Default events of a webhook; cues must be chosen."""
PAUSES_S = (5.0, 300.0, 1800.0, 7200.0, 18000.0, 36000.0, 50400.0, 72000.0, 86400.0)
"""Pauses between tries, as Standard Webhooks recommends; after the last the delivery is given up."""


@dataclass(frozen=True, slots=True)
class Webhook:
    """A notified address. ``secret`` signs each delivery; it is stored encrypted."""

    id: str
    url: str
    events: tuple[Event, ...]
    secret: str
    created_at: str


@dataclass(frozen=True, slots=True)
class Delivery:
    """A pending notification of one address; ``tries`` have failed so far. ``secret`` is encrypted."""

    id: str
    url: str
    secret: str
    body: str
    tries: int


class WebhookStore(RowStore):
    """Webhooks and their deliveries in the database."""

    def add(self, url: str, events: tuple[Event, ...], server: ServerSecret) -> Webhook:
        """Add an address with a separate secret, which is returned unencrypted only this once."""
        secret = "whsec_" + base64.b64encode(secrets.token_bytes(32)).decode()
        hook = Webhook(f"wh_{secrets.token_hex(8)}", url, events, secret, format_now())
        row = {"id": hook.id, "url": url, "events": json.dumps(events)}
        row |= {"secret": server.encrypt(secret, SECRET_OF_WEBHOOK)}
        with self._engine.begin() as connection:
            connection.execute(insert(webhooks).values(row | {"created_at": hook.created_at}))
            record(connection, "webhook.added", other={"webhook": hook.id})
        return hook

    def find_all(self) -> tuple[Webhook, ...]:
        """Return every webhook, oldest first."""
        return tuple(
            Webhook(row.id, row.url, tuple(json.loads(row.events)), row.secret, row.created_at)
            for row in self._read_all(select(webhooks).order_by(webhooks.c.created_at))
        )

    def drop(self, webhook_id: str) -> None:
        """Delete an address and its pending deliveries. Raises NotHere."""
        with self._engine.begin() as connection:
            connection.execute(delete(deliveries).where(deliveries.c.webhook_id == webhook_id))
            if connection.execute(delete(webhooks).where(webhooks.c.id == webhook_id)).rowcount != 1:
                raise NotHere
            record(connection, "webhook.dropped", other={"webhook": webhook_id})

    def announce_cue(self, data: dict[str, str]) -> None:
        """Add the deliveries of a live session's cue to the webhooks that chose such events."""
        with self._engine.begin() as connection:
            _announce(connection, _read_hooks(connection), "live.cue", data)

    def find_due(self, elapsed_s: float) -> tuple[Delivery, ...]:
        """Subtract elapsed time from every delay; return the deliveries that are due."""
        if not self._read_value(select(func.count()).select_from(deliveries)):
            return ()
        due = (
            select(deliveries, webhooks.c.url, webhooks.c.secret)
            .join(webhooks, webhooks.c.id == deliveries.c.webhook_id)
            .where(deliveries.c.wait_s <= 0)
        )
        with self._engine.begin() as connection:
            connection.execute(update(deliveries).values(wait_s=deliveries.c.wait_s - elapsed_s))
            rows = connection.execute(due).all()
        return tuple(Delivery(row.id, row.url, row.secret, row.body, row.tries) for row in rows)

    def take(self, delivery: Delivery) -> bool:
        """Count a try in advance; return False if another server makes it or the delivery is given up."""
        mine = (deliveries.c.id == delivery.id, deliveries.c.tries == delivery.tries)
        if delivery.tries >= len(PAUSES_S):
            self._write(delete(deliveries).where(*mine))
            return False
        later = {"tries": delivery.tries + 1, "wait_s": PAUSES_S[delivery.tries]}
        return self._write(update(deliveries).where(*mine).values(later)) == 1

    def drop_delivery(self, delivery: Delivery) -> None:
        """Delete a completed delivery."""
        self._write(delete(deliveries).where(deliveries.c.id == delivery.id))


def announce_end(connection: Connection, analysis_id: str, state: JobState) -> None:
    """Add the deliveries for an analysis that has just ended, and for a batch that has ended with it."""
    hooks = _read_hooks(connection)
    if not hooks:
        return
    _announce(connection, hooks, "analysis.finished", {"analysis_id": analysis_id, "state": state.value})
    of_it = select(batch_items.c.batch_id).where(batch_items.c.analysis_id == analysis_id)
    for batch_id in connection.execute(of_it.distinct().order_by(batch_items.c.batch_id)).scalars().all():
        announce_batch(connection, batch_id)


def announce_batch(connection: Connection, batch_id: str) -> None:
    """Add the deliveries for a batch, if it is over."""
    hooks = _read_hooks(connection)
    if not hooks:
        return
    # lock the batch: two analyses that end together must not each count the other as unfinished
    connection.execute(select(batches.c.id).where(batches.c.id == batch_id).with_for_update())
    going_on = analyses.c.state.in_((JobState.QUEUED, JobState.RUNNING))
    count = select(func.count()).where(analyses.c.id.in_(select_items(batch_id)), going_on)
    if connection.execute(count).scalar_one() == 0:
        _announce(connection, hooks, "batch.finished", {"batch_id": batch_id})


def _read_hooks(connection: Connection) -> list[tuple[str, str]]:
    """Return id and events (JSON) of every webhook."""
    return [(hook.id, hook.events) for hook in connection.execute(select(webhooks.c.id, webhooks.c.events))]


def _announce(
    connection: Connection, hooks: list[tuple[str, str]], event: Event, data: dict[str, str]
) -> None:
    body = json.dumps({"type": event, "timestamp": format_now(), "data": data})
    rows = [
        {
            "id": f"msg_{secrets.token_hex(8)}",
            "webhook_id": webhook_id,
            "event": event,
            "body": body,
            "tries": 0,
            "wait_s": 0.0,
        }
        for webhook_id, events in hooks
        if event in json.loads(events)
    ]
    if rows:
        connection.execute(insert(deliveries), rows)
