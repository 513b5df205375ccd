"""Writes a simulated day as the devices write it, beside its truth, in one pass and in bounded memory."""

from contextlib import ExitStack
from pathlib import Path

from fusion.simulation.imu_rows import SecondCutter, make_rows
from fusion.simulation.sensor import Device
from fusion.simulation.shift import SimulatedShift, simulate_shift
from fusion.simulation.write_csv import ActilifeCsvWriter, Lsm9ds1CsvWriter
from fusion.simulation.write_gt3x import Gt3xWriter
from fusion.simulation.write_truth import TruthWriter


def write_recordings(
    folder: Path, device: Device, duration_h: float, seed: int, rate_hz: float | None = None
) -> tuple[Path, ...]:
    """Simulate a day and write it into ``folder``: all files of :func:`write_shift`."""
    return write_shift(folder, simulate_shift(device, duration_h, seed, rate_hz))


def write_shift(folder: Path, shift: SimulatedShift, *, actilife_csv: bool = True) -> tuple[Path, ...]:
    """Write the recording, then truth.parquet and truth.json; gives the paths in this order.

    gt9x: ``shift_seed1.gt3x`` and, unless told otherwise, ActiLife's export ``shift_seed1-IMU.csv``;
    lsm9ds1: ``shift_seed1.csv``. The folder is made if it is not there. Same shift, same bytes.
    """
    folder.mkdir(parents=True, exist_ok=True)
    if shift.device == "gt9x":
        return _write_gt9x(folder, shift, actilife_csv=actilife_csv)
    return _write_lsm9ds1(folder, shift)


def _write_gt9x(folder: Path, shift: SimulatedShift, *, actilife_csv: bool) -> tuple[Path, ...]:
    paths = [folder / f"shift_seed{shift.seed}.gt3x"]
    cutter = SecondCutter(shift.rate_hz)
    with ExitStack() as files:
        truth = files.enter_context(TruthWriter(folder, shift))
        writers: list[Gt3xWriter | ActilifeCsvWriter] = [files.enter_context(Gt3xWriter(paths[0], shift))]
        if actilife_csv:
            paths.append(folder / f"shift_seed{shift.seed}-IMU.csv")
            writers.append(files.enter_context(ActilifeCsvWriter(paths[1], shift)))
        for block in shift.blocks():
            truth.write(block)
            seconds = cutter.cut(make_rows(shift, block))
            for writer in writers if len(seconds.counts) else ():
                writer.write(seconds)
    return (*paths, *truth.paths)


def _write_lsm9ds1(folder: Path, shift: SimulatedShift) -> tuple[Path, ...]:
    path = folder / f"shift_seed{shift.seed}.csv"
    with TruthWriter(folder, shift) as truth, Lsm9ds1CsvWriter(path, shift) as recording:
        for block in shift.blocks():
            truth.write(block)
            recording.write(block)
    return (path, *truth.paths)
