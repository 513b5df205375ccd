"""The results of ``acromion run`` as pandas tables and figures."""

import json
import re
from collections.abc import Hashable, Mapping
from dataclasses import dataclass
from datetime import datetime
from functools import cached_property
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from acromion.fusion.angle_files.elevation_parquet import read_elevation
from acromion.fusion.comparison.days import describe_group
from acromion.fusion.comparison.mixed import select_counted
from acromion.fusion.conventions import FORMULA_SIGN, FORMULA_START
from acromion.fusion.elevation import Elevation
from acromion.fusion.errors import DOUBLE_RECORDING
from acromion.fusion.exposure.plots import BLUE, INK, ORANGE, draw_day, make_axes
from acromion.fusion.exposure.types import MinuteProfile
from acromion.fusion.recording import MICROSECONDS, Span

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_GUARD = re.compile(f"{FORMULA_START}'{FORMULA_SIGN}")
"""The apostrophe that a run puts before a sign of a formula, for safety in a spreadsheet."""


@dataclass(frozen=True)
class Study:
    """The results folder of ``acromion run``, as the last run left it.

    ``folder``: the folder.
    ``run``: the content of ``run.json``: versions, machine, settings and recordings.
    """

    folder: Path
    run: Mapping[str, Any]

    @classmethod
    def read(cls, folder: str | PathLike[str]) -> "Study":
        """Read the results folder of ``acromion run``.

        Parameters
        ----------
        folder
            The folder that was given to ``acromion run`` with ``-o``.

        Returns
        -------
        Study
            Its tables are read when they are first used.

        Raises
        ------
        FileNotFoundError
            The folder has no ``run.json``: no run has finished in it.
        """
        place = Path(folder).absolute()
        return cls(place, json.loads((place / "run.json").read_bytes()))

    def __repr__(self) -> str:
        every, people = len(self.summary), self.summary["subject"].nunique()
        codes = self.summary["error_code"].dropna()
        failed, doubles = (codes != DOUBLE_RECORDING).sum(), (codes == DOUBLE_RECORDING).sum()
        doubled = f", {doubles} doubled" if doubles else ""
        recordings = "1 recording" if every == 1 else f"{every} recordings"
        persons = "1 person" if people == 1 else f"{people} people"
        return f"Study({self.folder.name}: {recordings}, {failed} failed{doubled}, {persons})"

    @cached_property
    def summary(self) -> pd.DataFrame:
        """One row for each recording; a failed one has an ``error_code`` and no figures."""
        return self.read_table("summary")

    @cached_property
    def days(self) -> pd.DataFrame:
        """One row for each day of an arm; ``left_out`` says why a day does not count.

        A day counts from 4 h of analysed time on, or as ``acromion run --min-hours`` states.
        """
        return self.read_table("days")

    @cached_property
    def hours(self) -> pd.DataFrame:
        """One row for each hour of the clock of a recording."""
        return self.read_table("hours")

    @cached_property
    def periods(self) -> pd.DataFrame:
        """One row for each period of a diary."""
        return self.read_table("periods")

    @cached_property
    def tasks(self) -> pd.DataFrame:
        """One row for each task of a recording; periods of one name are pooled."""
        return self.read_table("tasks")

    @cached_property
    def postures(self) -> pd.DataFrame:
        """One row for each posture of a recording: seated, upright or unstated."""
        return self.read_table("postures")

    @cached_property
    def pairs(self) -> pd.DataFrame:
        """One row for each pair of left and right arm; without a certain pair, an ``error_code``."""
        return self.read_table("pairs")

    @cached_property
    def marks(self) -> pd.DataFrame:
        """One row for each mark of a diary."""
        return self.read_table("marks")

    @cached_property
    def problems(self) -> pd.DataFrame:
        """One row for each failed recording, with its cause and fix."""
        return self.read_table("problems")

    @property
    def methods(self) -> str:
        """The methods paragraph for a paper, from the settings of the run."""
        return (self.folder / "methods.md").read_text("utf-8")

    def read_table(self, name: str) -> pd.DataFrame:
        """Read a table of the folder by its name, with the types that ``datapackage.json`` declares.

        Codes stay text: "007" is not a number. An empty cell is missing. Text is as it was given, without the
        apostrophe that guards a spreadsheet from formulas, and therefore as in the Parquet tables.

        Parameters
        ----------
        name
            File name without ".csv".

        Returns
        -------
        pandas.DataFrame
            Text as ``object``, numbers as ``float64``.

        Raises
        ------
        FileNotFoundError
            The run did not write this table.
        """
        package = json.loads((self.folder / "datapackage.json").read_bytes())
        schemas = {one["path"]: one["schema"]["fields"] for one in package["resources"]}
        kinds: dict[Hashable, type] = {
            field["name"]: str if field["type"] == "string" else float
            for field in schemas.get(f"{name}.csv", ())
        }
        path = self.folder / f"{name}.csv"
        header = pd.read_csv(path, nrows=0, encoding="utf-8").columns
        names = [_GUARD.sub(r"\1\2", column) for column in header]
        table = pd.read_csv(
            path, header=0, names=names, dtype=kinds, keep_default_na=False, na_values=[""], encoding="utf-8"
        )
        if name != "redcap_import":  # REDCap needs the text as it is
            for column in (column for column in names if kinds.get(column) is str):
                table[column] = table[column].str.replace(_GUARD, r"\1\2", regex=True)
        return table

    def find_folder(self, recording: str) -> Path:
        """Return the results folder of a recording.

        Parameters
        ----------
        recording
            Its path as in the column ``path`` of the tables, or its file name.

        Returns
        -------
        pathlib.Path
            The folder with ``results.json`` and ``elevation.parquet``.

        Raises
        ------
        LookupError
            No analysed recording of the last run has this name, or several have it.
        """
        for column in ("path", "file_name"):
            found = self.summary.loc[self.summary[column] == recording, "folder"].dropna()
            if len(found) == 1:
                return self.folder / str(found.iloc[0])
        raise LookupError(f"{recording!r} is not one analysed recording of {self.folder}")

    def read_results(self, recording: str) -> dict[str, Any]:
        """Return ``results.json`` of a recording, named as in :meth:`find_folder`."""
        results: dict[str, Any] = json.loads((self.find_folder(recording) / "results.json").read_bytes())
        return results

    def read_elevation(self, recording: str) -> Elevation:
        """Return the angle of a recording, named as in :meth:`find_folder`."""
        return read_elevation(self.find_folder(recording) / "elevation.parquet")

    def plot_day(self, recording: str) -> "Figure":
        """Draw the day of a recording, named as in :meth:`find_folder`, as :meth:`acromion.Analysis.plot`."""
        results = self.read_results(recording)
        if results["recording"]["side"] == "trunk":
            raise ValueError(f"{recording} is of the trunk; read_elevation returns its angles")
        start, minutes = results["recording"]["start"], results["exposure"]["minutes"]
        excluded = [
            Span(round(one["start_s"] * MICROSECONDS), round(one["duration_s"] * MICROSECONDS))
            for one in results["time"]["exclusions"]
        ]
        return draw_day(
            MinuteProfile(**{name: np.array(column, float) for name, column in minutes.items()}),
            datetime.fromisoformat(start) if start else None,
            excluded,
            recording,
        )

    def plot_people(
        self, figure: str = "time_above_60_percent", days: pd.DataFrame | None = None
    ) -> "Figure":
        """Draw a figure of every day by person, with the mean of each person and of all people.

        Parameters
        ----------
        figure
            A column of ``days``.
        days
            The rows to draw; all of :attr:`days` if omitted.

        Returns
        -------
        matplotlib.figure.Figure
            One line for each person, sorted by the mean; dots are days, left and right arm apart.

        Raises
        ------
        ModuleNotFoundError
            matplotlib is not installed.
        ValueError
            No day counts.
        """
        return _draw_people(self.days if days is None else days, figure)


def list_days(rows: pd.DataFrame, figure: str) -> dict[str, tuple[float, ...]]:
    """Return the days of each person, for :func:`describe_group` and :func:`compare_people`.

    A person is the unit of analysis, and a day is counted once.

    Parameters
    ----------
    rows
        Rows of :attr:`Study.days` of one arm, for example ``days.query("side == 'right'")``.
    figure
        The column with the figure; rows without it, and days that do not count (``left_out``), are skipped.

    Returns
    -------
    dict
        The values of each person's days, by the code of the person.

    Raises
    ------
    ValueError
        A row has no subject code, or one day of a person has two rows (both arms).
    """
    known = select_counted(rows).dropna(subset=[figure])
    if known["subject"].isna().any():
        raise ValueError("a row has no subject code; select the rows with one")
    twice = known.duplicated(["subject", "day"]) & known["day"].notna()
    if twice.any():
        person, day = known.loc[twice, ["subject", "day"]].iloc[0]
        raise ValueError(
            f"{person} has two rows on {day}; select one arm, such as rows.query(\"side == 'right'\")"
        )
    people = known.groupby("subject")[figure]
    return {str(person): tuple(values.tolist()) for person, values in people}


def _draw_people(days: pd.DataFrame, figure: str) -> "Figure":
    """Draw the days of each person as dots and their mean as a bar, each arm apart, sorted by the mean.

    Line and band: the mean of the people and its range, by
    :func:`acromion.fusion.comparison.days.describe_group`.
    """
    known = select_counted(days).dropna(subset=["subject", figure])
    if known.empty:
        raise ValueError("no day counts; the column left_out says why")
    order = known.groupby("subject")[figure].mean().sort_values().index
    drawn, axes = make_axes(7.0, 1.6 + 0.25 * len(order))
    lines = {person: number for number, person in enumerate(order)}
    sides = known["side"].fillna("arm not stated")
    for side, color, shift in (("left", BLUE, 0.15), ("right", ORANGE, -0.15), ("arm not stated", INK, 0.0)):
        rows = known[sides == side]
        if rows.empty:
            continue
        at = rows["subject"].map(lines).to_numpy(float) + shift
        axes.plot(rows[figure], at, "o", color=color, alpha=0.6, markersize=4, label=side)
        people = {str(person): values.tolist() for person, values in rows.groupby("subject")[figure]}
        means = [float(np.mean(values)) for values in people.values()]
        axes.plot(means, [lines[person] + shift for person in people], "|", color=color, markersize=12)
        group = describe_group(people)
        axes.axvline(group.mean, color=color, linewidth=1)
        if group.mean_range is not None:
            axes.axvspan(group.mean_range.low, group.mean_range.high, color=color, alpha=0.12, linewidth=0)
    axes.set_yticks(range(len(order)), list(order))
    axes.set_ylim(-0.6, len(order) - 0.4)
    axes.set(xlabel=f"{figure}: days, means, and 95 % range of the people's mean")
    drawn.legend(ncols=3, loc="outside lower center", frameon=False)
    return drawn
