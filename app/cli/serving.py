"""Commands that keep running: the server and its workers."""

from pathlib import Path
from typing import Annotated

import typer

from app.cli.said import Exit, print_problem
from app.errors import AppError
from app.logs import start_logging


def serve(
    host: Annotated[str, typer.Option(help="Only this computer, until accounts exist.")] = "127.0.0.1",
    port: Annotated[int, typer.Option(min=0, max=65535)] = 8080,
    data: Annotated[Path, typer.Option(metavar="DIR", help="Where recordings and reports are kept.")] = Path(
        "acromion-data"
    ),
    workers: Annotated[
        int, typer.Option("-j", "--jobs", min=0, help="Analyses at once; 0 leaves them to other workers.")
    ] = 2,
    open_: Annotated[bool, typer.Option("--open", help="Open the page in the browser.")] = False,
    watch: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Take in what is put into this folder, too.")
    ] = None,
) -> None:
    """Serve the page and the API, with the workers that do the analyses."""
    from app.main import serve as serve_app  # noqa: PLC0415
    from app.settings import Settings  # noqa: PLC0415

    try:
        settings = Settings(host=host, port=port, data_dir=data, workers=workers, watch_dir=watch)
        serve_app(settings, open_browser=open_)
    except AppError as refusal:
        print_problem("serve", refusal.code, refusal.facts, "en")
        raise typer.Exit(Exit.USAGE) from None


def worker(
    data: Annotated[Path, typer.Option(metavar="DIR", help="The data folder of the server.")] = Path(
        "acromion-data"
    ),
) -> None:
    """Do queued analyses until stopped; any number may run beside the server."""
    from app.jobs.database import check_whole, name_start_trouble  # noqa: PLC0415
    from app.jobs.worker import run_by_settings  # noqa: PLC0415
    from app.settings import Settings  # noqa: PLC0415

    settings = Settings(data_dir=data)
    try:
        start_logging()
        with name_start_trouble(settings):
            check_whole(settings.database_url)
        run_by_settings(settings)
    except AppError as refusal:
        print_problem("worker", refusal.code, refusal.facts, "en")
        raise typer.Exit(Exit.USAGE) from None
