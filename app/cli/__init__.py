"""The command line. Users' scripts depend on command names, options and exit codes; do not change them.

Each module has one kind of command. The commands get their names here, in the order of the help.
"""

import io
import sys

import typer

from acromion.app.cli.admin import (
    account,
    backup,
    doctor,
    drill,
    get,
    hold,
    recover,
    restore,
    retention,
    serve,
    trail,
    verify,
    worker,
)
from acromion.app.cli.compare import compare, pair, profile, validate
from acromion.app.cli.files import conformance, demo, export, inspect, posture, simulate, version
from acromion.app.cli.live import live
from acromion.app.cli.output import PipedOutput
from acromion.app.cli.run import collect, exposure, run

app = typer.Typer(
    name="acromion",
    help="From a full-shift upper-arm motion recording to a report a clinician can act on.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
)

for command in (
    *(run, collect, export, exposure, pair, compare, profile, validate),
    *(live, demo, simulate, conformance, inspect, posture, version),
    *(serve, worker, get, backup, restore, drill, recover, verify, doctor, retention),
):
    app.command()(command)
app.add_typer(trail, name="trail")
app.add_typer(hold, name="hold")
app.add_typer(account, name="account")


def main() -> None:
    """Run the command ``acromion``."""
    if isinstance(sys.stdout, io.TextIOWrapper):
        out = sys.stdout
        buffering = (out.line_buffering, out.write_through)
        sys.stdout = PipedOutput(out.buffer, out.encoding, out.errors, None, *buffering)
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):  # unprintable characters must not stop a run
            stream.reconfigure(errors="replace")
    app()
