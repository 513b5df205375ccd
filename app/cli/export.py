"""The command that writes finished results in a convention of the field."""

from pathlib import Path
from typing import Annotated

import typer

from app.cli.output import Exit, print_problem
from app.errors import NO_RESULTS
from app.report.figures import load_results
from app.report.words.wording import fill, load_wording
from app.request import Language
from app.storage.store import write_durably


def export(
    results: Annotated[
        list[Path], typer.Argument(metavar="RESULTS...", help="Results of acromion run, or folders of them.")
    ],
    out: Annotated[
        Path, typer.Option("-o", "--out", help="Folder for the Motion-BIDS dataset; new or empty.")
    ],
    lang: Annotated[Language, typer.Option("--lang", help="Language of messages.")] = "en",
) -> None:
    """Write the angles of finished recordings as a Motion-BIDS dataset (docs/conventions.md)."""
    from app.report.export.bids import Angles, list_bids  # noqa: PLC0415  Parquet, and only this needs it

    folders = [folder for path in results for folder in _find_finished(path)]
    if not folders:
        print_problem(", ".join(map(str, results)), NO_RESULTS, {}, lang)
        raise typer.Exit(Exit.NOTHING_DONE)
    if out.exists() and any(out.iterdir()):
        raise typer.BadParameter(f"{out} is not empty", param_hint="-o")
    every = [
        Angles(load_results((f / "results.json").read_bytes()), f / "elevation.parquet") for f in folders
    ]
    for name, content in list_bids(every):
        path = out / name
        path.parent.mkdir(parents=True, exist_ok=True)
        write_durably(path, content)
    words = load_wording(lang, "run")["outcome"]
    typer.echo(fill(words["exported"], {"n": str(len(folders)), "folder": str(out)}))


def _find_finished(path: Path) -> list[Path]:
    """List the folders of finished recordings: the one named, or those directly below it."""
    candidates = [path, *sorted(path.iterdir())] if path.is_dir() else []
    names = ("results.json", "elevation.parquet")
    return [folder for folder in candidates if all((folder / name).exists() for name in names)]
