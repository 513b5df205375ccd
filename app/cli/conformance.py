"""The command that tells whether another program gives the figures of page 1 (docs/profile.md)."""

import csv
from collections.abc import Iterator, Mapping
from math import isnan
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from app.cli.output import Exit

if TYPE_CHECKING:
    from fusion.simulation.conformance import Expected, TestSignal

RESULTS = "results.csv"
Given = Mapping[tuple[str, str], float | None]


def conformance(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="Where the signals go and the results lie.")],
) -> None:
    """Write test signals with expected values; check DIR/results.csv where another program's figures lie."""
    folder.mkdir(parents=True, exist_ok=True)
    for path in write_signals(folder):
        typer.echo(path)
    if not (folder / RESULTS).exists():
        typer.echo(f"No {RESULTS} yet: signal,figure,value, one row for each row of expected.csv.")
        return
    told = list(check_results(read_results(folder / RESULTS)))
    for line in told:
        typer.echo(line)
    wrong = sum(not line.startswith("ok") for line in told)
    typer.echo(f"{len(told) - wrong} of {len(told)} figures within their tolerances")
    if wrong:
        raise typer.Exit(Exit.SOME_FAILED)


def _list_signals() -> "tuple[TestSignal, ...]":
    from fusion.simulation.conformance import SIGNALS  # noqa: PLC0415  heavy, and only this needs it

    return SIGNALS


def write_signals(folder: Path) -> Iterator[Path]:
    """Write each signal (time_s,elevation_deg; empty where missing) and what is expected of it."""
    for signal in _list_signals():
        yield _write_signal(folder / f"{signal.name}.csv", signal)
    path = folder / "expected.csv"
    with path.open("w", encoding="utf-8", newline="") as file:
        rows = csv.writer(file)
        rows.writerow(("signal", "figure", "unit", "value", "tolerance"))
        for signal in _list_signals():
            for item in signal.expected:
                rows.writerow((signal.name, item.figure, item.unit, f"{item.value:.6g}", item.tolerance))
    yield path


def _write_signal(path: Path, signal: "TestSignal") -> Path:
    told = (
        f"{time_s:.3f},{'' if isnan(angle_deg) else f'{angle_deg:.6f}'}\n"
        for time_s, angle_deg in zip(*(column.tolist() for column in signal.sample()), strict=True)
    )
    path.write_text("time_s,elevation_deg\n" + "".join(told), encoding="utf-8")
    return path


def read_results(path: Path) -> Given:
    """Read the figures of another program; a value that is no number counts as missing."""
    with path.open(encoding="utf-8-sig", newline="") as file:
        rows = list(csv.DictReader(file))
    return {
        (row.get("signal") or "", row.get("figure") or ""): _read_number(row.get("value")) for row in rows
    }


def _read_number(text: str | None) -> float | None:
    try:
        return float(text or "")
    except ValueError:
        return None


def check_results(given: Given) -> Iterator[str]:
    """Tell of each expected figure whether the one given is within its tolerance."""
    for signal in _list_signals():
        for item in signal.expected:
            yield _tell(signal.name, item, given.get((signal.name, item.figure)))


def _tell(signal: str, item: "Expected", value: float | None) -> str:
    wanted = f"{signal} {item.figure}: expected {item.value:.6g} ± {item.tolerance:g} {item.unit}"
    if value is None:
        return f"MISSING {wanted}"
    within = abs(value - item.value) <= item.tolerance + 1e-9
    return f"{'ok' if within else 'OUTSIDE'} {wanted}, given {value:g}"
