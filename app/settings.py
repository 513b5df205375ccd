"""Settings of the server, chosen by the administrator; they do not change any figure."""

from pathlib import Path
from typing import Any, Literal

from pydantic import Field, field_validator
from pydantic_settings import BaseSettings, SettingsConfigDict

from acromion.app.request import Paper
from acromion.fusion.conventions import PoseHeld

GIB = 1 << 30


def _build_database_url(known: dict[str, Any]) -> str:
    return f"sqlite:///{known['data_dir'] / 'acromion.sqlite3'}"


class Settings(BaseSettings):
    """Settings of the server and its workers; each can be set as ``ACROMION_<NAME>``.

    Attributes
    ----------
    data_dir
        Folder for the database, the recordings and the reports, unless other settings move them elsewhere.
    database_url
        Database: SQLite in the data folder or, for example, ``postgresql+psycopg://acromion@db/acromion``.
    object_store
        Store for recordings and reports: empty for the data folder, or ``s3://bucket``. Its endpoint, region
        and keys are in ``AWS_ENDPOINT``, ``AWS_REGION``, ``AWS_ACCESS_KEY_ID``, ``AWS_SECRET_ACCESS_KEY``.
    engine
        How workers find jobs: ``embedded`` polls the database; with ``procrastinate`` PostgreSQL notifies
        workers on many machines.
    host, port
        Address of the server; port 0 picks a free one. Any address other than this computer's needs accounts,
        ``hosts``, and TLS through ``tls_cert`` or ``proxy``.
    hosts
        Host names of the server, separated by commas; those of this computer are always accepted.
    proxy
        Address of a proxy on this computer that ends TLS and forwards requests: ``127.0.0.1`` or ``unix``.
        The server trusts the client address that it sends (the last one in ``X-Forwarded-For``), but never a
        sign-in.
    second_factor
        ``required``: a password also needs an authenticator code; ``offered``: each person may turn it on.
    oidc_issuer, oidc_client_id, oidc_client_secret
        Identity provider for sign-in (OpenID Connect), and the client registered there for this server.
    oidc_claim, oidc_roles
        The claim of the ID token that lists a person's roles, and its values as ``value=role``, separated by
        commas; without ``oidc_roles`` the values are the names of the roles.
    no_secret
        Whether everyone on this computer may use a server without accounts; must be chosen explicitly.
    tls_cert, tls_key
        Certificate (PEM, with its chain) and key for HTTPS; both or neither.
    workers
        Number of worker processes that ``serve`` keeps running.
    max_upload_bytes, min_free_bytes
        Maximum size of a recording; free disk space below which uploads are rejected.
    max_uploads_at_once
        Maximum number of simultaneous uploads (each uses about a megabyte of memory); further ones are
        rejected and can be retried.
    max_cache_bytes
        Disk space for decoded samples, which speed up a second analysis of a recording.
    root_path
        Path under which a proxy serves Acromion, such as "/acromion"; the proxy must remove it from requests.
        Empty at the root of a host.
    watch_dir
        Folder from which recordings are imported automatically; None: no folder.
    watch_pose_held
        "start": the pose was held at the start of wear in every recording of the watched folder.
    lease_s
        A worker renews its lease on a job every second; it loses the job after two lease periods without
        renewal.
    max_attempts
        How often the analysis may die while its worker is alive before a recording is given up.
    max_interruptions
        How often the worker or its computer may stop during an analysis before it fails (E-INTERRUPTED).
    max_put_backs
        How often an analysis waits for space on a full disk before it fails with E-DISK. The waits are 2 s
        at first and 60 s at most (20 waits: a quarter of an hour in all).
    memory_limit_bytes
        Address space of one analysis (numba and BLAS map far more than they use).
    wall_limit_s, wall_limit_s_per_gb
        Longest time for one analysis: the first, plus the second for each GB of the file. An analysis without
        progress is stopped after half of it.
    min_body_rate_bytes_per_s, body_patience_s, header_patience_s
        A client that sends more slowly than this, for longer than this, is disconnected.
    webhooks_may_be_private
        Whether a webhook may use an address in a private network or on this computer.
    paper
        Default paper size of PDFs: ``a4`` or ``letter``.
    appendix
        Whether PDFs have their appendix (all tables, full method, bibliography) by default.
    max_queued
        Maximum number of waiting analyses; further ones are rejected until some are done.
    upload_term_s, trash_term_s
        How long an unfinished upload and the trash are kept; only time while the server runs counts.
    """

    model_config = SettingsConfigDict(env_prefix="ACROMION_", frozen=True)

    data_dir: Path = Path("acromion-data")
    database_url: str = Field(default_factory=_build_database_url)
    object_store: str = ""
    engine: Literal["embedded", "procrastinate"] = "embedded"
    host: str = "127.0.0.1"
    port: int = Field(default=8080, ge=0, le=65535)
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
    workers: int = Field(default=2, ge=0)
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
    appendix: bool = False
    max_queued: int = 100_000
    upload_term_s: float = 24 * 3600.0
    trash_term_s: float = 30 * 24 * 3600.0

    @field_validator("data_dir", "watch_dir", "tls_cert", "tls_key", mode="before")
    @classmethod
    def check_path(cls, value: object) -> object:
        """Raise ValueError for an empty path, which would mean the current folder."""
        if value == "":
            raise ValueError("PATH")
        return value

    @field_validator("database_url")
    @classmethod
    def check_database_url(cls, value: str) -> str:
        """Raise ValueError if the address has no scheme."""
        if "://" not in value:
            raise ValueError("sqlite:///FILE, postgresql+psycopg://USER@HOST/NAME")
        return value

    @property
    def host_names(self) -> frozenset[str]:
        """Host names of the server, in addition to this computer's."""
        return frozenset(filter(None, (name.strip().lower() for name in self.hosts.split(","))))

    @property
    def is_database_inside(self) -> bool:
        """Whether the database is in the data folder."""
        return self.database_url == _build_database_url({"data_dir": self.data_dir})

    def as_environment(self) -> dict[str, str]:
        """Return the chosen settings as environment variables for a worker, without the sign-in settings."""
        chosen = {name: getattr(self, name) for name in self.model_fields_set if not name.startswith("oidc_")}
        return {f"ACROMION_{name.upper()}": str(value) for name, value in chosen.items() if value is not None}
