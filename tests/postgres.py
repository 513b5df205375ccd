"""A real PostgreSQL of the tests' own, on a socket in a folder of its own."""

import os
import shutil
import subprocess
import tempfile
from pathlib import Path

from sqlalchemy import create_engine, text


def find_binaries() -> Path | None:
    """Return the folder of PostgreSQL's programs; Debian keeps them out of the path."""
    found = shutil.which("initdb")
    installed = sorted(Path("/usr/lib/postgresql").glob("*/bin"))
    return Path(found).parent if found else next(reversed(installed), None)


BINARIES = find_binaries()


class PostgresServer:
    """A cluster that nobody else sees; it runs as ``postgres`` where we are root, for it refuses root."""

    def __init__(self, connections: int = 200) -> None:
        assert BINARIES is not None
        self.folder = Path(tempfile.mkdtemp(prefix="acromion-pg-"))
        self._connections = connections
        self._user = "postgres" if os.geteuid() == 0 else None
        if self._user:
            shutil.chown(self.folder, self._user)
        self._run("initdb", "--no-sync", "-A", "trust", "-U", "postgres", "-E", "UTF8", "--locale=C.UTF-8")
        self.start()

    @property
    def url(self) -> str:
        """How SQLAlchemy reaches it."""
        return f"postgresql+psycopg://postgres@/postgres?host={self.folder}"

    def start(self) -> None:
        """Start, and wait until it answers."""
        options = (
            f"-k {self.folder} -c listen_addresses='' -c max_connections={self._connections} -c fsync=off"
        )
        self._run("pg_ctl", "-w", "-l", str(self.folder / "log"), "-o", options, "start")

    def stop(self, mode: str = "fast") -> None:
        """Stop; ``immediate`` is as a crash."""
        self._run("pg_ctl", "-w", "-m", mode, "stop")

    def empty(self) -> None:
        """Leave no table behind."""
        engine = create_engine(self.url)
        with engine.begin() as connection:
            end_all = "SELECT pg_terminate_backend(pid, 60000) FROM pg_stat_activity"
            others = "pid <> pg_backend_pid() AND datname = current_database()"
            connection.execute(text(f"{end_all} WHERE {others}"))
            schemas = text("SELECT nspname FROM pg_namespace WHERE nspname !~ '^pg_|^information_schema$'")
            for name in connection.execute(schemas).scalars().all():
                connection.execute(text(f'DROP SCHEMA "{name}" CASCADE'))
            connection.execute(text("CREATE SCHEMA public"))
        engine.dispose()

    def remove(self) -> None:
        """Stop, and leave nothing behind."""
        self.stop("immediate")
        shutil.rmtree(self.folder)

    def _run(self, program: str, *arguments: str) -> None:
        assert BINARIES is not None
        command = [str(BINARIES / program), "-D", str(self.folder / "cluster"), *arguments]
        subprocess.run(
            command, check=True, user=self._user, cwd=self.folder, stdout=subprocess.DEVNULL, timeout=300
        )
