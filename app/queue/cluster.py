"""Workers on any number of machines: Procrastinate notifies them, the job row decides.

A trigger in PostgreSQL defers one Procrastinate job for each analysis that becomes queued, in the transaction
that writes the row. That job is only a notification: the worker that receives it claims a row like every
other worker, and a superfluous notification finds no row. One of the running workers, the leader, puts back
rows with expired leases, and replaces lost notifications. The others only check whether it still leads.
"""

import asyncio
import logging
import os
import signal
from functools import partial

from procrastinate import App, PsycopgConnector
from procrastinate.exceptions import ConnectorException
from procrastinate.schema import SchemaManager
from sqlalchemy import inspect, text
from sqlalchemy.engine import make_url
from sqlalchemy.exc import OperationalError

from acromion.app.analysis.attempt import MakeReport
from acromion.app.analysis.fork_server import warm_up_and_wait
from acromion.app.library.database.connect import connect, lock_tables
from acromion.app.queue.leader import REVIVAL, Leader
from acromion.app.queue.worker import (
    TROUBLE_S,
    WorkerContext,
    open_worker_context,
    return_expired,
    run_next_patiently,
    setting_reports,
)
from acromion.app.settings import Settings

QUEUE, TASK = "analyses", "run_next"
REVIVE_S = 1.0
STALLED_S, BEAT_S = 30.0, 3.0
"""When Procrastinate considers a worker dead, and how often each sends a heartbeat: for notifications only.
"""
LEADER_SILENCE_S = 30.0

_TRIGGER = f"""
CREATE OR REPLACE FUNCTION acromion_wake() RETURNS trigger LANGUAGE plpgsql AS $$
BEGIN
  PERFORM procrastinate_defer_jobs_v1(
    ARRAY[ROW('{QUEUE}', '{TASK}', 0, NULL, NULL, '{{}}'::jsonb, NULL)::procrastinate_job_to_defer_v1]);
  RETURN NULL;
END $$;
CREATE OR REPLACE TRIGGER acromion_wake AFTER INSERT OR UPDATE OF state ON analyses
  FOR EACH ROW WHEN (NEW.state = 'queued') EXECUTE FUNCTION acromion_wake();
"""
_TOP_UP = text(
    "UPDATE analyses SET state = state WHERE state = 'queued' AND NOT EXISTS "
    "(SELECT 1 FROM procrastinate_jobs WHERE status = 'todo' AND queue_name = :queue)"
).bindparams(queue=QUEUE)

logger = logging.getLogger(__name__)


def install(url: str) -> None:
    """Create Procrastinate's tables and our trigger if they are missing; notify workers of waiting jobs."""
    engine = connect(url)
    with engine.begin() as connection:
        lock_tables(connection)
        has_tables = inspect(connection).has_table("procrastinate_jobs")
        for script in (_TRIGGER,) if has_tables else (SchemaManager.get_schema(), _TRIGGER):
            connection.exec_driver_sql(script.replace("%", "%%"))
        connection.execute(_TOP_UP)
    engine.dispose()


def run_cluster_worker(
    settings: Settings, make: MakeReport | None = None, parent_pid: int | None = None
) -> None:
    """Run jobs until SIGTERM or SIGINT, or until the parent is gone.

    ``make`` replaces the analysis in tests.
    """
    worker = open_worker_context(settings, make)
    warm_up_and_wait()
    try:
        with setting_reports(worker):
            asyncio.run(_work(worker, parent_pid))
    finally:
        worker.store.close()


async def _work(worker: WorkerContext, parent_pid: int | None) -> None:
    """Listen for jobs until the worker is stopped, or its parent is gone."""
    for number in (signal.SIGTERM, signal.SIGINT):
        asyncio.get_running_loop().add_signal_handler(number, worker.stopping.set)
    listener = asyncio.create_task(_listen_on(worker))
    try:
        while not worker.stopping.is_set():
            if parent_pid is not None and os.getppid() != parent_pid:
                worker.stopping.set()
            await asyncio.sleep(0.2)
    finally:
        listener.cancel()
        await asyncio.gather(listener, return_exceptions=True)


async def _listen_on(worker: WorkerContext) -> None:
    """Listen for jobs; start again after a lost connection to the database."""
    address = make_url(worker.settings.database_url).set(drivername="postgresql")
    connector = PsycopgConnector(conninfo=address.render_as_string(hide_password=False))
    engine = App(connector=connector)  # it does one job at a time
    engine.task(name=TASK, queue=QUEUE)(partial(run_next_patiently, worker, is_label=False))
    while True:
        try:
            await asyncio.to_thread(install, worker.settings.database_url)
            async with engine.open_async():
                await _listen(worker, engine)
        except (ConnectorException, OperationalError, OSError):
            logger.exception("the database does not respond; listening again soon")
            await asyncio.sleep(TROUBLE_S)


async def _listen(worker: WorkerContext, engine: App) -> None:
    listener = asyncio.create_task(
        engine.run_worker_async(
            queues=[QUEUE],
            install_signal_handlers=False,
            delete_jobs="always",
            stalled_worker_timeout=STALLED_S,
            update_heartbeat_interval=BEAT_S,
        )
    )
    leader = Leader(worker.store.engine, REVIVAL, LEADER_SILENCE_S)
    tasks = (listener, asyncio.create_task(_revive_forever(worker, engine, leader)))
    try:
        done, _ = await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
    finally:
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
        await asyncio.to_thread(leader.close)
    for task in done:
        task.result()


def revive_if_leading(worker: WorkerContext, leader: Leader) -> bool:
    """If this worker leads, put back the rows of dead workers and replace lost notifications."""
    if not leader.is_leader():
        return False
    return_expired(worker)
    worker.store.run(_TOP_UP)
    return True


async def _revive_forever(worker: WorkerContext, engine: App, leader: Leader) -> None:
    """Put back jobs of dead workers every ``REVIVE_S``."""
    while True:
        try:
            if await asyncio.to_thread(revive_if_leading, worker, leader):
                manager = engine.job_manager
                stalled = await manager.get_stalled_jobs(queue=QUEUE, seconds_since_heartbeat=STALLED_S)
                for job in stalled:  # jobs of dead workers
                    await manager.retry_job(job)
        except OperationalError:
            logger.warning("nothing revived: the database does not respond")
        await asyncio.sleep(REVIVE_S)
