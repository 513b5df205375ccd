"""The command that tells whether another program gives the figures of page 1 (docs/profile.md)."""

import csv
from collections.abc import Iterator, Sequence
from contextlib import suppress
from math import isnan
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from app.cli.output import Exit

if TYPE_CHECKING:
    from fusion.simulation.conformance import Expected, TestSignal

RESULTS = "results.csv"


def conformance(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="Where the signals go and the results lie.")],
) -> None:
    """Write test signals with expected values; check DIR/results.csv where another program's figures lie."""
    from fusion.simulation.conformance import SIGNALS  # noqa: PLC0415  heavy, and only this needs it

    folder.mkdir(parents=True, exist_ok=True)
    for path in _write_signals(folder, SIGNALS):
        typer.echo(path)
    if not (folder / RESULTS).exists():
        typer.echo(f"No {RESULTS} yet: signal,figure,value, one row for each row of expected.csv.")
        return
    given = _read_results(folder / RESULTS)
    told = [
        _check(one.name, item, given.get((one.name, item.figure))) for one in SIGNALS for item in one.expected
    ]
    for line in told:
        typer.echo(line)
    wrong = sum(not line.startswith("ok") for line in told)
    typer.echo(f"{len(told) - wrong} of {len(told)} figures within their tolerances")
    if wrong:
        raise typer.Exit(Exit.SOME_FAILED)


def _write_signals(folder: Path, signals: "Sequence[TestSignal]") -> Iterator[Path]:
    """Write each signal (time_s,elevation_deg; empty where missing) and what is expected of it."""
    for signal in signals:
        told = (
            f"{time_s:.3f},{'' if isnan(angle_deg) else f'{angle_deg:.6f}'}\n"
            for time_s, angle_deg in zip(*(column.tolist() for column in signal.sample()), strict=True)
        )
        path = folder / f"{signal.name}.csv"
        path.write_text("time_s,elevation_deg\n" + "".join(told), encoding="utf-8")
        yield path
    path = folder / "expected.csv"
    with path.open("w", encoding="utf-8", newline="") as file:
        rows = csv.writer(file)
        rows.writerow(("signal", "figure", "unit", "value", "tolerance"))
        for signal in signals:
            for item in signal.expected:
                rows.writerow((signal.name, item.figure, item.unit, f"{item.value:.6g}", item.tolerance))
    yield path


def _read_results(path: Path) -> dict[tuple[str, str], float]:
    """Read the figures of another program; a value that is no number counts as missing."""
    given = {}
    with path.open(encoding="utf-8-sig", newline="") as file:
        for row in csv.DictReader(file):
            with suppress(ValueError):
                given[row.get("signal") or "", row.get("figure") or ""] = float(row.get("value") or "")
    return given


def _check(signal: str, item: "Expected", value: float | None) -> str:
    """Return whether the figure given is within the tolerance of the one expected."""
    wanted = f"{signal} {item.figure}: expected {item.value:.6g} ± {item.tolerance:g} {item.unit}"
    if value is None:
        return f"MISSING {wanted}"
    within = abs(value - item.value) <= item.tolerance + 1e-9
    return f"{'ok' if within else 'OUTSIDE'} {wanted}, given {value:g}"
