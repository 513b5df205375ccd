"""The container files name only settings and commands that exist."""

import re
from pathlib import Path
from typing import Any

import pytest
import typer.main
import yaml

from app.cli import app
from app.settings import Settings

DOCKER = Path(__file__).resolve().parents[2] / "docker"
FILES = sorted(path for path in DOCKER.iterdir() if path.is_file())
COMPOSE = sorted(DOCKER.glob("*.yaml"))
MANY = DOCKER / "compose.many.yaml"


def read(path: Path) -> dict[str, Any]:
    content: dict[str, Any] = yaml.safe_load(path.read_text())
    return content


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.name)
def test_every_variable_of_ours_is_a_setting(path: Path) -> None:
    named = {name.lower() for name in re.findall(r"\bACROMION_(\w+)", path.read_text())}

    assert named <= set(Settings.model_fields)


@pytest.mark.parametrize("path", COMPOSE, ids=lambda path: path.name)
def test_every_command_of_a_service_is_one_of_ours(path: Path) -> None:
    ours = [service for service in read(path)["services"].values() if service["image"] == "acromion"]

    group = typer.main.get_command(app)
    for service in ours:
        if "command" in service:
            name, *arguments = service["command"]
            command = group.commands[name]  # type: ignore[attr-defined]
            command.make_context(name, arguments, resilient_parsing=False)


@pytest.mark.parametrize("path", COMPOSE, ids=lambda path: path.name)
def test_every_service_of_ours_is_locked_down(path: Path) -> None:
    ours = [service for service in read(path)["services"].values() if service["image"] == "acromion"]

    assert ours
    for service in ours:
        assert service["read_only"] is True
        assert service["user"] == "1000:1000"
        assert service["cap_drop"] == ["ALL"]


@pytest.mark.parametrize("path", COMPOSE, ids=lambda path: path.name)
def test_every_volume_of_a_service_is_declared(path: Path) -> None:
    compose = read(path)

    used = {
        volume.partition(":")[0]
        for service in compose["services"].values()
        for volume in service.get("volumes", ())
    }
    files = {name for name in used if name.startswith("./")}

    assert used - files == set(compose["volumes"])
    assert files <= {"./organisation.key"}


def test_web_and_worker_of_many_machines_have_the_same_key() -> None:
    services = read(MANY)["services"]

    for name in ("web", "worker"):
        key = services[name]["environment"]["ACROMION_KEY_FILE"]
        assert f"./organisation.key:{key}:ro" in services[name]["volumes"]


def test_the_image_installs_the_versions_that_are_tested() -> None:
    def list_pins(lock: Path) -> set[str]:
        return set(re.findall(r"^([\w.-]+==[\w.]+)", lock.read_text(), re.MULTILINE))

    installed = list_pins(DOCKER / "requirements.lock")

    assert installed
    assert installed <= list_pins(DOCKER.parent / "requirements.lock")


def test_a_worker_s_memory_folder_holds_the_largest_recording_and_what_it_keeps_besides() -> None:
    worker = read(DOCKER / "compose.many.yaml")["services"]["worker"]
    example = dict(re.findall(r"^(\w+)=(\S+)$", (DOCKER / "env.example").read_text(), re.MULTILINE))
    (room,) = (re.search(r"^/work:size=(\d+)g", place) for place in worker["tmpfs"] if "/work" in place)

    largest = int(example["ACROMION_MAX_UPLOAD_BYTES"])
    kept = int(worker["environment"]["ACROMION_MAX_CACHE_BYTES"])

    assert room is not None
    assert int(room[1]) << 30 >= largest + kept + (1 << 30)
