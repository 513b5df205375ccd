"""The command that lays several days over one another."""

from collections.abc import Iterator
from errno import ENOENT
from functools import partial
from os import strerror
from pathlib import Path
from typing import Annotated

import typer

from app.batch.folder import write_version
from app.cli.compare import KindsOption, MixedMethodsOption, SameSubjectOption
from app.cli.options import LanguageOption, Out, PaperOption, parse_kinds
from app.cli.output import Exit, print_problem
from app.errors import UNREADABLE_PATH, AppError, CannotProfile
from app.request import ProfileRequest

RESULTS = "results.json"


def profile(
    results: Annotated[
        list[Path],
        typer.Argument(metavar="RESULTS...", help="Folders that acromion run made, or results.json in them."),
    ],
    out: Out,
    after: Annotated[
        list[Path] | None,
        typer.Option(metavar="RESULTS", help="Days after a change; may be repeated. RESULTS are before it."),
    ] = None,
    same_subject: SameSubjectOption = False,
    mixed_methods: MixedMethodsOption = False,
    lang: LanguageOption = "en",
    report: KindsOption = "html,pdf",
    paper: PaperOption = "a4",
) -> None:
    """Lay the days of a person, or of a group, over one another: mean, spread, days still needed."""
    from app.roads.profile import make_profile  # noqa: PLC0415  heavy, and only this needs it

    kinds = parse_kinds(report)
    folder = out / "days"
    try:
        first = _find_all(results, out)
        later = _find_all(after or [], out)
        request = ProfileRequest(
            len(first) if after else None, (lang,), kinds, paper, same_subject, mixed_methods
        )
        make = partial(make_profile, (*first, *later), request)
        marker = write_version(folder, request.figures_name, lang, make)
    except AppError as refusal:
        print_problem(folder.name, refusal.code, refusal.facts, lang)
        raise typer.Exit(Exit.NOTHING_DONE) from None
    except OSError as error:
        print_problem(error.filename or str(folder), UNREADABLE_PATH, {"why": error.strerror or ""}, lang)
        raise typer.Exit(Exit.NOTHING_DONE) from None
    typer.echo(f"{folder.name} -> {folder}" + (f" (version {marker.version})" if marker.version > 1 else ""))
    for line in (folder / "answer.txt").read_text("utf-8").splitlines():
        typer.echo(f"  {line}")


def _find_all(paths: list[Path], out: Path) -> list[Path]:
    """Give the folders of finished analyses at the paths and below them; earlier versions are left aside.

    Raises
    ------
    CannotProfile
        When a path leads to none, or all lead to one and the same.
    FileNotFoundError
        When there is nothing at a path.
    """
    found: dict[Path, None] = {}
    for path in paths:
        if not path.exists():
            raise FileNotFoundError(ENOENT, strerror(ENOENT), str(path))
        folders = sorted(_find_below(path, out))
        if not folders:
            raise CannotProfile(why="kept", name=path.name)
        found |= dict.fromkeys(folder.resolve() for folder in folders)
    if len(found) == 1 and len(paths) > 1:
        raise CannotProfile(why="same", name=paths[0].name, other=paths[1].name)
    return list(found)


def _find_below(path: Path, out: Path) -> Iterator[Path]:
    if path.is_file():
        yield path.parent
        return
    for results in path.rglob(RESULTS):
        inside = results.parent.relative_to(path).parts
        is_earlier = any(part.startswith(".") or _is_version(part) for part in inside)
        if not is_earlier and not results.is_relative_to(out / "days"):
            yield results.parent


def _is_version(name: str) -> bool:
    return name[:1] == "v" and name[1:].isdigit()
