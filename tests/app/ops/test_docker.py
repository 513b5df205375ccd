"""The container files name only settings and commands that exist."""

import configparser
import json
import re
import shlex
from pathlib import Path
from typing import Any

import pytest
import typer.main
import yaml

from acromion.app.cli import app
from acromion.app.errors import ExamplePassword, ForeignAddress
from acromion.app.settings import Settings
from acromion.app.start_checks import check_exposure, check_passwords
from benchmarks.third_party import Package, add_licences, read_lock
from tests import ROOT

DOCKER = ROOT / "docker"
FILES = sorted(path for path in DOCKER.iterdir() if path.is_file())
COMPOSE = sorted(DOCKER.glob("*.yaml"))


def read(path: Path) -> dict[str, Any]:
    content: dict[str, Any] = yaml.safe_load(path.read_text())
    return content


@pytest.fixture(params=COMPOSE, ids=lambda path: path.name)
def compose(request: pytest.FixtureRequest) -> dict[str, Any]:
    """Return the content of a compose file."""
    return read(request.param)


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.name)
def test_every_variable_of_ours_is_a_setting(path: Path) -> None:
    named = {name.lower() for name in re.findall(r"\bACROMION_(\w+)", path.read_text())}

    assert named <= set(Settings.model_fields)


def test_every_command_of_a_service_is_one_of_ours(compose: dict[str, Any]) -> None:
    ours = [service for service in compose["services"].values() if service["image"] == "acromion"]

    group = typer.main.get_command(app)
    for service in ours:
        if "command" in service:
            name, *arguments = service["command"]
            command = group.commands[name]  # type: ignore[attr-defined]
            command.make_context(name, arguments, resilient_parsing=False)


def test_every_service_is_locked_down_with_limits_a_log_that_does_not_grow_and_a_pinned_image(
    compose: dict[str, Any],
) -> None:
    services = compose["services"].values()
    ours = [service for service in services if service["image"] == "acromion"]

    assert ours
    for service in ours:
        assert (service["read_only"], service["user"], service["cap_drop"]) == (True, "1000:1000", ["ALL"])
    for service in services:
        assert service["mem_limit"]
        assert service["pids_limit"]
        assert set(service["logging"]["options"]) == {"max-size", "max-file"}
        assert service["security_opt"] == ["no-new-privileges:true"]
        assert service in ours or re.search(r":[\w.]*\d+[.-]\d+[\w.-]*$", service["image"])


def test_every_volume_of_a_service_is_declared(compose: dict[str, Any]) -> None:
    places = (place for service in compose["services"].values() for place in service.get("volumes", ()))
    assert {place.partition(":")[0] for place in places if not place.startswith("./")} == set(
        compose["volumes"]
    )


@pytest.mark.parametrize("path", COMPOSE, ids=lambda path: path.name)
def test_every_file_that_a_service_is_given_is_there_or_said_to_be_made(path: Path) -> None:
    compose, text = read(path), path.read_text()
    given = [name for service in compose["services"].values() for name in list_files(service)]

    assert [name for name in given if not (DOCKER / name).exists() and f"docker/{name}" not in text] == []


def list_files(service: dict[str, Any]) -> list[str]:
    mounted = (volume.partition(":")[0] for volume in service.get("volumes", ()))
    return [name.removeprefix("./") for name in mounted if name.startswith("./")] + list(
        service.get("env_file", ())
    )


def test_the_base_of_the_image_is_pinned_by_its_digest() -> None:
    bases = re.findall(r"^FROM (\S+)", (DOCKER / "Dockerfile").read_text(), re.MULTILINE)

    assert len(bases) == 2
    assert len(set(bases)) == 1
    assert re.fullmatch(r"python:3\.\d+\.\d+-\S+@sha256:[0-9a-f]{64}", bases[0])


def read_values(name: str) -> dict[str, str]:
    """Return what a file of variables sets."""
    return dict(re.findall(r"^(\w+)=(\S*)$", (DOCKER / name).read_text(), re.MULTILINE))


def test_acromion_is_given_no_key_of_the_stores_owners() -> None:
    services = read(DOCKER / "compose.many.yaml")["services"]
    ours = {
        name
        for service in services.values()
        if service["image"] == "acromion"
        for name in service["env_file"]
    }

    assert ours == {".env"}
    assert not [name for name in read_values("env.example") if "ROOT" in name or "POSTGRES" in name]


def test_the_key_of_acromion_opens_its_bucket_and_no_other() -> None:
    policy = json.loads((DOCKER / "bucket-policy.json").read_text())

    places = {place for statement in policy["Statement"] for place in statement["Resource"]}
    acts = {act for statement in policy["Statement"] for act in statement["Action"]}
    assert places == {"arn:aws:s3:::acromion", "arn:aws:s3:::acromion/*"}
    assert not any("*" in act for act in acts)


def test_the_passwords_of_the_examples_fit_together() -> None:
    ours, theirs = read_values("env.example"), read_values("stores.env.example")

    assert f"acromion:{theirs['DATABASE_PASSWORD']}@" in ours["ACROMION_DATABASE_URL"]
    assert ours["AWS_ACCESS_KEY_ID"] == theirs["BUCKET_USER"]
    assert ours["AWS_SECRET_ACCESS_KEY"] == theirs["BUCKET_PASSWORD"]


def read_serve(arguments: list[str]) -> Settings:
    """Read the settings that a command line of the server gives."""
    command = typer.main.get_command(app).commands["serve"]  # type: ignore[attr-defined]
    given = command.make_context("serve", list(arguments)).params
    return Settings(
        host=given["host"], tls_cert=given["tls_cert"], proxy=given["proxy"], hosts="clinic.example"
    )


def test_the_clinics_container_may_be_reached_by_others_once_there_are_accounts() -> None:
    service = read(DOCKER / "compose.clinic.yaml")["services"]["acromion"]

    settings = read_serve(service["command"][1:])

    assert settings.host == "0.0.0.0"
    check_exposure(settings, has_accounts=True)
    with pytest.raises(ForeignAddress):
        check_exposure(settings, has_accounts=False)
    assert "ACROMION_HOSTS" in read_values("clinic.env.example")


def read_unit(name: str = "acromion.service") -> configparser.RawConfigParser:
    unit = configparser.RawConfigParser(strict=False)
    unit.optionxform = str  # type: ignore[assignment,method-assign]
    unit.read(DOCKER / name)
    return unit


def test_the_nightly_backup_writes_into_a_folder_that_its_unit_may_write() -> None:
    service = read_unit("acromion-backup.service")["Service"]
    program, *arguments = shlex.split(service["ExecStart"])

    command = typer.main.get_command(app).commands["backup"]  # type: ignore[attr-defined]
    given = command.make_context("backup", arguments[1:]).params

    assert (program, arguments[0]) == ("/opt/acromion/bin/acromion", "backup")
    assert str(given["file"]) == service["ReadWritePaths"]
    assert given["keep"] == 14
    assert service["EnvironmentFile"] == read_unit()["Service"]["EnvironmentFile"]
    assert read_unit("acromion-backup.timer")["Timer"]["OnCalendar"] == "*-*-* 02:30"


def test_the_units_server_is_reached_by_the_proxys_socket_alone() -> None:
    program, *arguments = shlex.split(read_unit()["Service"]["ExecStart"])

    settings = read_serve(arguments[1:])

    assert (program, arguments[0]) == ("/opt/acromion/bin/acromion", "serve")
    assert settings.host == "unix:/run/acromion/acromion.sock"
    assert settings.host in (DOCKER / "nginx.conf").read_text()
    check_exposure(settings, has_accounts=True)
    with pytest.raises(ForeignAddress):
        check_exposure(settings, has_accounts=False)


def test_the_unit_is_locked_down_and_has_limits() -> None:
    unit = read_unit()["Service"]

    locked = {
        "User": "acromion", "UMask": "0077", "NoNewPrivileges": "yes", "CapabilityBoundingSet": "",
        "ProtectSystem": "strict", "ProtectHome": "yes", "PrivateTmp": "yes",
        "SystemCallFilter": "@system-service", "StateDirectoryMode": "0700", "OOMPolicy": "continue",
    }  # fmt: skip
    assert locked.items() <= dict(unit).items()
    assert all(unit[name] for name in ("MemoryMax", "TasksMax", "LogRateLimitBurst", "TimeoutStopSec"))


def test_the_proxy_logs_no_query_and_no_address_that_logs_somebody_in() -> None:
    text = (DOCKER / "nginx.conf").read_text()

    (line,) = re.findall(r"log_format acromion '([^']*)'", text)
    assert not {"$request", "$request_uri", "$args", "$uri"} & set(re.findall(r"\$\w+", line))
    (ways,) = re.findall(r"~\^/login/\(\?<acromion_way>(\S+)\)/", text)
    assert ways == "link|once"
    assert "proxy_set_header X-Forwarded-For $remote_addr;" in text  # whatever a caller says of its address


def test_without_tls_the_proxy_leads_pages_on_and_refuses_scripts() -> None:
    text = (DOCKER / "nginx.conf").read_text()
    (plain,) = re.findall(r"server \{\n    listen 80;\n(.*?)\n\}", text, re.DOTALL)

    answers = dict(re.findall(r"location (\S+) \{ return (\d+)", plain))

    assert answers == {"/": "301", "/api/": "403", "/metrics": "403"}


@pytest.mark.parametrize("name", ["ACROMION_DATABASE_URL", "AWS_SECRET_ACCESS_KEY"])
def test_no_server_starts_with_a_password_of_the_examples(name: str) -> None:
    example = read_values("env.example")
    own = {"ACROMION_DATABASE_URL": "sqlite://", "AWS_SECRET_ACCESS_KEY": "x"} | {name: example[name]}

    with pytest.raises(ExamplePassword) as refused:
        check_passwords(Settings(database_url=own["ACROMION_DATABASE_URL"]), own)

    assert refused.value.facts["name"] == name


def test_the_image_installs_the_versions_that_are_tested() -> None:
    def list_pins(lock: Path) -> set[str]:
        return set(re.findall(r"^([\w.-]+==[\w.]+)", lock.read_text(), re.MULTILINE))

    installed = list_pins(DOCKER / "requirements.lock")

    assert installed
    assert installed <= list_pins(DOCKER.parent / "requirements.lock")


def test_a_worker_s_memory_folder_holds_the_largest_recording_and_what_it_keeps_besides() -> None:
    worker = read(DOCKER / "compose.many.yaml")["services"]["worker"]
    example = read_values("env.example")
    (room,) = (re.search(r"^/work:size=(\d+)g", place) for place in worker["tmpfs"] if "/work" in place)

    largest = int(example["ACROMION_MAX_UPLOAD_BYTES"])
    kept = int(worker["environment"]["ACROMION_MAX_CACHE_BYTES"])

    assert room is not None
    assert int(room[1]) << 30 >= largest + kept + (1 << 30)


# What the image brings along may be shipped with it.


def test_every_locked_package_has_a_licence_that_may_be_shipped() -> None:
    assert [package for package in read_lock() if not package.may_be_shipped] == []


@pytest.mark.parametrize(
    ("licence", "may_be_shipped"),
    [
        ("MIT", True),
        ("Apache-2.0 OR GPL-2.0-only", True),
        ("BSD-3-Clause AND GPL-2.0-only", False),
        ("BSD-2-Clause AND Apache-2.0 WITH LLVM-exception", True),
        ("AGPL-3.0-only", False),
        ("unknown", False),
    ],
)
def test_a_licence_is_accepted_by_each_of_its_parts(licence: str, may_be_shipped: bool) -> None:
    assert Package("any", "1", licence).may_be_shipped is may_be_shipped


def test_the_list_names_each_licence() -> None:
    document: dict[str, object] = {"components": [{"name": "h11", "version": "0.16.0"}]}

    add_licences(document, {"h11": Package("h11", "0.16.0", "MIT")})

    named = [{"expression": "MIT", "acknowledgement": "declared"}]
    assert document == {"components": [{"name": "h11", "version": "0.16.0", "licenses": named}]}
