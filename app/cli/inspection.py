"""Commands that only print: what a file is, which version this is."""

import json
from pathlib import Path
from typing import Annotated

import typer

from app.cli.options import LanguageOption, ProfileOption, SensorOption, name_sensor, read_profile_file
from app.cli.output import Exit, print_problem
from app.errors import UNREADABLE_PATH
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

    try:
        facts = inspect_file(path, rate_hz, name_sensor(read_profile_file(profile, lang), sensor))
    except FusionError as refusal:
        if as_json:
            typer.echo(_write_refusal(path.name, refusal))
        print_problem(path.name, refusal.code, refusal.facts, lang)
        raise typer.Exit(Exit.NOTHING_DONE) from None
    except OSError as error:
        print_problem(path.name, UNREADABLE_PATH, {"why": error.strerror or ""}, lang)
        raise typer.Exit(Exit.NOTHING_DONE) from None
    typer.echo(
        json.dumps(facts, indent=1, ensure_ascii=False) if as_json else describe_inspection(facts, lang)
    )


def _write_refusal(name: str, refusal: FusionError) -> str:
    return json.dumps({"file": name, "code": refusal.code, "facts": dict(refusal.facts)}, indent=1)


def version() -> None:
    """Print the version and the fingerprint of the code."""
    typer.echo(f"acromion {software_version()} ({software_revision()})")
