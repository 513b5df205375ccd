"""Commands that make recordings: a demonstration, and files as the devices write them."""

from pathlib import Path
from typing import Annotated, Literal

import typer

from app.batch.plan import plan_tasks
from app.cli.options import LanguageOption
from app.cli.output import choose_exit, finish, report_progress
from app.request import ReportRequest


def demo(
    out: Annotated[Path, typer.Option("-o", "--out", help="Folder for the results.")] = Path("acromion-demo"),
    hours: Annotated[float, typer.Option(min=0.1, max=24)] = 8.0,
    lang: LanguageOption = "en",
    open_: Annotated[bool, typer.Option("--open", help="Open the report in the browser.")] = False,
) -> None:
    """Simulate a shift, analyse it, write the report, say where."""
    from fusion.simulation import simulate_shift, write_shift  # noqa: PLC0415  heavy, and only this needs it

    typer.echo(f"Simulating {hours:g} h of work with a GT9X Link ...")
    shift = simulate_shift("gt9x", hours, seed=1)
    log = write_shift(out / "recording", shift, actilife_csv=False)[0]
    request = ReportRequest(log.name, "DEMO", "right", languages=(lang,), pose_held="start")
    tasks = plan_tasks([log], out, request, force=False)
    outcomes = report_progress(tasks, 1)
    if not choose_exit(outcomes):
        page = (tasks[0].folder / "report.html").resolve()
        typer.echo(f"Report: {page}\n        {page.with_suffix('.pdf')}")
        if open_:
            typer.launch(page.as_uri())
    finish(outcomes, out, request)


def simulate(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="Where the recordings go.")],
    device: Annotated[Literal["gt9x", "lsm9ds1"], typer.Option()],
    hours: Annotated[float, typer.Option(min=0.01, max=48)] = 8.0,
    seed: Annotated[int, typer.Option(min=0)] = 1,
    rate_hz: Annotated[float | None, typer.Option(min=10, max=2000)] = None,
) -> None:
    """Write recordings as the devices write them, and the truth beside them."""
    from fusion.simulation import write_recordings  # noqa: PLC0415

    for path in write_recordings(folder, device, hours, seed, rate_hz):
        typer.echo(path)
