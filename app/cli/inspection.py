"""Commands that only print: what a file is, which version this is."""

import json
from pathlib import Path
from typing import Annotated

import typer

from app.cli.options import LanguageOption, ProfileOption, SensorOption, name_sensor, read_profile_file
from app.cli.output import refusals_printed
from app.version import software_revision, software_version
from fusion.errors import FusionError


def inspect(
    path: Annotated[Path, typer.Argument(metavar="FILE")],
    as_json: Annotated[bool, typer.Option("--json", help="Machine-readable.")] = False,
    rate_hz: Annotated[float | None, typer.Option(min=1, max=10_000)] = None,
    profile: ProfileOption = None,
    sensor: SensorOption = "",
    lang: LanguageOption = "en",
) -> None:
    """Say what the file is: device, columns, units, rate, clock, gaps, warnings. Analyses nothing."""
    from app.report.inspection import describe_inspection  # noqa: PLC0415
    from app.roads.inspect import inspect_file  # noqa: PLC0415

    with refusals_printed(path.name, lang):
        try:
            facts = inspect_file(path, rate_hz, name_sensor(read_profile_file(profile, lang), sensor))
        except FusionError as refusal:
            if as_json:
                told = {"file": path.name, "code": refusal.code, "facts": dict(refusal.facts)}
                typer.echo(json.dumps(told, indent=1))
            raise
    typer.echo(
        json.dumps(facts, indent=1, ensure_ascii=False) if as_json else describe_inspection(facts, lang)
    )


def version() -> None:
    """Print the version and the fingerprint of the code."""
    typer.echo(f"acromion {software_version()} ({software_revision()})")
