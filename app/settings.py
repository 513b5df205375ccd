"""Settings of the machine, chosen by the person who runs Acromion; none changes a number."""

from pathlib import Path
from typing import Any, Literal

from pydantic import Field
from pydantic_settings import BaseSettings, SettingsConfigDict

from app.request import Paper
from fusion.conventions import PoseHeld

GIB = 1 << 30


def _build_database_url(known: dict[str, Any]) -> str:
    return f"sqlite:///{known['data_dir'] / 'acromion.sqlite3'}"


class Settings(BaseSettings):
    """Settings of the server and its workers; each may be given as ``ACROMION_<NAME>``.

    Attributes
    ----------
    data_dir
        Folder that holds the database, the recordings and the reports, but for what is kept elsewhere.
    database_url
        Where the rows are: SQLite in the data folder or, say, ``postgresql+psycopg://acromion@db/acromion``.
    object_store
        Where recordings and reports are: nothing for the data folder, or ``s3://bucket``, whose endpoint,
        region and keys stand in ``AWS_ENDPOINT``, ``AWS_REGION``, ``AWS_ACCESS_KEY_ID``,
        ``AWS_SECRET_ACCESS_KEY``.
    engine
        How workers learn of work: ``embedded`` polls the rows; ``procrastinate`` is notified by PostgreSQL,
        for workers on many machines.
    host, port
        Where the server listens; port 0 takes a free one. Any address but this computer's own needs accounts,
        ``hosts``, and TLS by ``tls_cert`` or ``proxy``.
    hosts
        Names by which the server may be asked for, with commas between; this computer's own always are.
    proxy
        The address from which a proxy on this computer, which ends TLS, forwards requests: ``127.0.0.1`` or
        ``unix``. What it says of a client's address (the last of ``X-Forwarded-For``) is believed, no login.
    second_factor
        ``required``: a password needs an authenticator's code, too; ``offered``: for those who want to.
    oidc_issuer, oidc_client_id, oidc_client_secret
        An identity provider by which people log in (OpenID Connect), and what it knows this server by.
    oidc_claim, oidc_roles
        The claim of the ID token that says somebody's roles, and its values as ``value=role`` with commas
        between; without ``oidc_roles`` the values are the names of the roles.
    no_secret
        Whether anybody on this computer may use a server without accounts: a stated choice.
    tls_cert, tls_key
        Certificate (PEM, with its chain) and key for HTTPS; both or neither.
    workers
        Worker processes that ``serve`` keeps alive.
    max_upload_bytes, min_free_bytes
        Largest recording taken; free space below which no upload is taken.
    max_uploads_at_once
        Uploads whose bytes are taken at the same time (each costs about a megabyte of memory); more are
        refused for the moment.
    max_cache_bytes
        Space for decoded samples, which make a second analysis of a recording quick.
    root_path
        Where a proxy serves us, as "/acromion" (it is to take this away before it asks us); empty at the
        root of a host.
    watch_dir
        A folder whose recordings are taken in without the page; None: none is watched.
    watch_pose_held
        "start": the pose was held at the start of wear in every recording of the watched folder.
    lease_s
        A worker renews its hold on a job every second; it loses the job after two leases without that.
    max_attempts
        Deaths of the analysis, while its worker lives, after which a recording is given up.
    max_interruptions
        Ends of the worker or its computer during one analysis after which it is set aside (E-INTERRUPTED).
    max_put_backs
        Times that an analysis waits for room on a full disk, 2 s at first and 60 s at most (20: a quarter of
        an hour in all), before it fails with E-DISK.
    memory_limit_bytes
        Address space of one analysis (numba and BLAS map far more than they touch).
    wall_limit_s, wall_limit_s_per_gb
        Longest time for one analysis: the first, plus the second for each GB of the file. An analysis without
        progress is stopped after half of it.
    min_body_rate_bytes_per_s, body_patience_s, header_patience_s
        A client that sends more slowly than this, for longer than this, is sent away.
    webhooks_may_be_private
        Whether a webhook may lead into a private network or to this computer.
    paper
        Paper of the PDFs where a request names none: ``a4`` or ``letter``.
    max_queued
        Analyses that may wait; more are refused until some are done.
    upload_term_s, trash_term_s
        How long the server keeps, while it runs, an upload that nobody goes on with, and what is
        in the trash.
    """

    model_config = SettingsConfigDict(env_prefix="ACROMION_", frozen=True)

    data_dir: Path = Path("acromion-data")
    database_url: str = Field(default_factory=_build_database_url)
    object_store: str = ""
    engine: Literal["embedded", "procrastinate"] = "embedded"
    host: str = "127.0.0.1"
    port: int = 8080
    hosts: str = ""
    proxy: str = ""
    second_factor: Literal["required", "offered"] = "required"
    oidc_issuer: str = ""
    oidc_client_id: str = ""
    oidc_client_secret: str = Field(default="", repr=False)
    oidc_claim: str = "roles"
    oidc_roles: str = ""
    no_secret: bool = False
    tls_cert: Path | None = None
    tls_key: Path | None = None
    workers: int = 1
    max_upload_bytes: int = 4 * GIB
    min_free_bytes: int = 2 * GIB
    max_uploads_at_once: int = 32
    max_cache_bytes: int = 4 * GIB
    root_path: str = ""
    watch_dir: Path | None = None
    watch_pose_held: PoseHeld | None = None
    lease_s: float = 4.0
    max_attempts: int = 3
    max_interruptions: int = 5
    max_put_backs: int = 20
    memory_limit_bytes: int = 6 * GIB
    wall_limit_s: float = 300.0
    wall_limit_s_per_gb: float = 3000.0
    min_body_rate_bytes_per_s: float = 10_000.0
    body_patience_s: float = 30.0
    header_patience_s: float = 10.0
    webhooks_may_be_private: bool = False
    paper: Paper = "a4"
    max_queued: int = 100_000
    upload_term_s: float = 24 * 3600.0
    trash_term_s: float = 30 * 24 * 3600.0

    @property
    def host_names(self) -> frozenset[str]:
        """Names by which the server may be asked for, beside this computer's own."""
        return frozenset(filter(None, (name.strip().lower() for name in self.hosts.split(","))))

    @property
    def is_database_inside(self) -> bool:
        """Whether the rows are in the data folder."""
        return self.database_url == _build_database_url({"data_dir": self.data_dir})

    def as_environment(self) -> dict[str, str]:
        """Return every setting that was chosen, as a worker process reads it, but for how people log in."""
        chosen = {name: getattr(self, name) for name in self.model_fields_set if not name.startswith("oidc_")}
        return {f"ACROMION_{name.upper()}": str(value) for name, value in chosen.items() if value is not None}
