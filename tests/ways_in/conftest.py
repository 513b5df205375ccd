"""A running server, and a recording to send."""

from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from acromion.fusion.simulation import write_recordings
from tests.conftest import SHARED_DATA
from tests.ways_in.servers import RunningServer

StartServer = Callable[..., RunningServer]


@pytest.fixture(scope="session")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A real .gt3x of three minutes or, where it is absent, a simulated one."""
    real = SHARED_DATA / "gt9x" / "link_imu_100hz_179s.gt3x"
    if real.exists():
        return real
    made = write_recordings(tmp_path_factory.mktemp("simulated"), "gt9x", 0.05, 1)
    return next(path for path in made if path.suffix == ".gt3x")


@pytest.fixture
def start_server(tmp_path: Path) -> Iterator[StartServer]:
    """Start servers of one data folder; whatever still runs at the end is stopped."""
    started: list[RunningServer] = []

    def start(**settings: str) -> RunningServer:
        started.append(RunningServer(tmp_path / "data", tmp_path / "server.log", 1, **settings))
        return started[-1]

    yield start
    for server in started:
        server.stop()
