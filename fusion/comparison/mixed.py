"""A mixed model of a figure: fixed effects such as tasks, with people and their days as random effects."""

import warnings
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from importlib import import_module
from math import sqrt
from typing import Any

import numpy as np
import pandas as pd
from scipy.special import stdtr, stdtrit

from acromion.fusion.exposure.types import Interval
from acromion.fusion.recording import Float64Array

_LEAST_LEVERAGE = 1e-9


@dataclass(frozen=True, slots=True)
class FixedEffect:
    """A fixed effect of a mixed model.

    ``name``: "intercept", a column, or "column: level" compared with the first level of this column.
    ``estimate``: in the figure's own unit.
    ``interval``: its 95 % range.
    ``p_value``: two-sided, of no effect.
    """

    name: str
    estimate: float
    interval: Interval
    p_value: float


@dataclass(frozen=True, slots=True)
class MixedModel:
    """A fitted mixed model.

    ``rows``, ``people``: number of each.
    ``effects``: the fixed effects; the first is the intercept.
    ``person_sd``, ``day_sd``, ``residual_sd``: deviations between people, between the days of a person, and
    within a day. ``day_sd`` is None if no day has two rows: days are then in ``residual_sd``.
    ``is_converged``: whether the fit reached an optimum; if not, do not report it.
    """

    rows: int
    people: int
    effects: tuple[FixedEffect, ...]
    person_sd: float
    day_sd: float | None
    residual_sd: float
    is_converged: bool


def select_counted(rows: pd.DataFrame) -> pd.DataFrame:
    """Return the rows without the days that do not count (``left_out``)."""
    return rows[rows["left_out"].isna()] if "left_out" in rows else rows


def fit_mixed_model(rows: pd.DataFrame, figure: str, fixed: str | Sequence[str] = ()) -> MixedModel:
    """Fit figure = intercept + fixed effects + person + day of the person + residual, by REML.

    The random effects are independent and normal (Laird and Ware 1982, doi:10.2307/2529876; Searle, Casella
    and McCulloch 1992, doi:10.1002/9780470316856). Effects often differ between people, which these random
    effects do not contain. Ranges therefore come from the spread between people: the standard error is the
    larger of the model's and the one by people as clusters (CR2), with Student's t and the degrees of freedom
    of Satterthwaite (Bell and McCaffrey 2002, Survey Methodology 28:169; Pustejovsky and Tipton 2018,
    doi:10.1080/07350015.2016.1247004). In balanced data with two tasks this is the paired t test of the
    people's means. A level of a category with one person has one degree of freedom.

    Parameters
    ----------
    rows
        A table with the columns ``subject``, ``day``, the figure and the fixed effects, such as
        :attr:`acromion.Study.tasks`. Rows with a missing cell in one of them are skipped, and days that do
        not count, if the table has the column ``left_out``; the tasks have none. Select one arm, unless
        "side" is a fixed effect.
    figure
        The column to explain.
    fixed
        A column with a fixed effect, or several, such as "label" for tasks, "side" or "job_title". Text is a
        category.

    Returns
    -------
    MixedModel
        Effects and deviations in the figure's own unit.

    Raises
    ------
    ModuleNotFoundError
        statsmodels is not installed.
    ValueError
        A column does not exist or has an infinite value, a row is there twice, a day has both arms and "side"
        is not a fixed effect, there are too few people for the fixed effects, nobody has two rows, the figure
        is the same in all rows, or fixed effects cannot be distinguished.
    """
    fixed = [fixed] if isinstance(fixed, str) else list(fixed)
    absent = [name for name in (figure, "subject", "day", *fixed) if name not in rows]
    if absent:
        raise ValueError(f"these columns do not exist: {', '.join(absent)}")
    try:
        mixed: Any = import_module("statsmodels.regression.mixed_linear_model")
    except ModuleNotFoundError as error:
        told = "statsmodels is not installed: it comes with the extra acromion[stats]"
        raise ModuleNotFoundError(told, name=error.name) from None
    known = (
        select_counted(rows)
        .dropna(subset=[figure, "subject", "day", *fixed])
        .sort_values(["subject", "day"], kind="stable")
    )
    infinite = [name for name in (figure, *fixed) if np.isinf(pd.to_numeric(known[name], "coerce")).any()]
    if infinite:
        raise ValueError(f"these columns have infinite values: {', '.join(infinite)}")
    _check_rows(known, fixed)
    design = _build_design(known, fixed)
    _check_design(known, design)
    values, scale = known[figure].to_numpy(float), float(known[figure].std())
    if not scale > 0.0:
        raise ValueError(f"{figure} is the same in all rows")
    days = _build_days(known)
    spec = mixed.VCSpec(["day"], [[["day"] * one.shape[1] for one in days]], [days]) if days else None
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # the caller reads is_converged
        model = mixed.MixedLM(
            values / scale,
            design.to_numpy(float),
            known["subject"].to_numpy(),
            exog_re=np.ones((len(known), 1)),
            exog_vc=spec,
        )
        found = model.fit(reml=True, method=["bfgs", "lbfgs", "powell"])
    person_sd = scale * sqrt(max(float(np.asarray(found.cov_re)[0, 0]), 0.0))
    day_sd = scale * sqrt(max(float(found.vcomp[0]), 0.0)) if days else None
    residual_sd = scale * sqrt(float(found.scale))
    sds = person_sd, day_sd or 0.0, residual_sd
    estimates, errors, freedoms = _estimate_effects(known, values, design, sds)
    effects = [
        _describe_effect(str(name), *(float(one[k]) for one in (estimates, errors, freedoms)))
        for k, name in enumerate(design.columns)
    ]
    people = known["subject"].nunique()
    is_converged = bool(found.converged)
    return MixedModel(len(known), people, tuple(effects), person_sd, day_sd, residual_sd, is_converged)


def _estimate_effects(
    rows: pd.DataFrame, values: Float64Array, design: pd.DataFrame, sds: tuple[float, float, float]
) -> tuple[Float64Array, Float64Array, Float64Array]:
    """Return fixed effects, their standard errors and degrees of freedom, for known deviations.

    The effects are generalised least squares. The covariance of the fitted model is unusable if a deviation
    is 0.
    """
    people = list(_whiten_people(rows, values, design.to_numpy(float), sds))
    covariance = np.linalg.inv(sum(columns.T @ columns for columns, _ in people))
    estimates = covariance @ sum(columns.T @ own for columns, own in people)
    scores, weights, lengths = [], [], []
    for columns, own in people:
        leverage, axes = np.linalg.eigh(np.eye(len(own)) - columns @ covariance @ columns.T)
        is_free = leverage > _LEAST_LEVERAGE
        adjusted = (axes[:, is_free] / np.sqrt(leverage[is_free])) @ axes[:, is_free].T @ columns @ covariance
        scores.append(adjusted.T @ (own - columns @ estimates))
        weights.append(adjusted.T @ columns)
        lengths.append((adjusted**2).sum(axis=0))
    errors = np.sqrt(np.maximum(np.diag(covariance), (np.array(scores) ** 2).sum(axis=0)))
    freedoms = [
        _find_freedom(np.diag([length[k] for length in lengths]) - parts @ covariance @ parts.T)
        for k, parts in enumerate(np.array(weights).transpose(1, 0, 2))
    ]
    people_with = np.sum([(columns != 0.0).any(axis=0) for columns, _ in people], axis=0)
    return np.asarray(estimates, np.float64), errors, np.where(people_with == 1, 1.0, freedoms)


def _whiten_people(
    rows: pd.DataFrame, values: Float64Array, columns: Float64Array, sds: tuple[float, float, float]
) -> Iterator[tuple[Float64Array, Float64Array]]:
    """Yield the design and the values of each person, whose rows then have independent errors of 1."""
    subjects, days = rows["subject"].to_numpy(), rows["day"].to_numpy()
    for person in rows["subject"].unique():
        own = np.flatnonzero(subjects == person)
        same_day = days[own][:, None] == days[own][None, :]
        root = np.linalg.cholesky(sds[0] ** 2 + sds[1] ** 2 * same_day + sds[2] ** 2 * np.eye(len(own)))
        whitened = np.linalg.solve(root, np.column_stack([columns[own], values[own]]))
        yield np.asarray(whitened[:, :-1], np.float64), np.asarray(whitened[:, -1], np.float64)


def _find_freedom(spread: Float64Array) -> float:
    """Return the degrees of freedom of a variance, at least 1; ``spread``: the covariance of its parts."""
    squares = float((spread**2).sum())
    return max(float(np.trace(spread)) ** 2 / squares, 1.0) if squares else 1.0


def _check_rows(known: pd.DataFrame, fixed: Sequence[str]) -> None:
    """Raise ValueError if a row of a run is there twice, or both arms of a day without the effect "side"."""
    if "path" in known and known.astype(str).duplicated().any():
        raise ValueError("a row is there twice")
    if "side" in known and "side" not in fixed:
        arms = known.groupby(["subject", "day"])["side"].nunique()
        if (arms > 1).any():
            subject, day = arms.index[arms > 1][0]
            raise ValueError(f"{subject} has both arms on {day}: select one, or make side a fixed effect")


def _build_design(rows: pd.DataFrame, fixed: Sequence[str]) -> pd.DataFrame:
    """Return the intercept, a column for each number, and one for each level of a category but the first."""
    columns = [pd.Series(1.0, rows.index, name="intercept")]
    for name in fixed:
        if pd.api.types.is_numeric_dtype(rows[name]):
            columns.append(rows[name].astype(float))
        else:
            levels = sorted(set(rows[name].astype(str)))
            columns += [(rows[name] == one).astype(float).rename(f"{name}: {one}") for one in levels[1:]]
    return pd.concat(columns, axis=1)


def _check_design(rows: pd.DataFrame, design: pd.DataFrame) -> None:
    """Raise ValueError if the model cannot be fitted."""
    spread = design.groupby(rows["subject"]).agg(np.ptp).max()
    if rows["subject"].nunique() <= int((spread == 0.0).sum()):
        raise ValueError("too few people for the fixed effects")
    if not rows["subject"].duplicated().any():
        raise ValueError("nobody has two rows")
    if np.linalg.matrix_rank(design.to_numpy(float)) < design.shape[1]:
        raise ValueError(
            f"these fixed effects cannot be distinguished: {', '.join(map(str, design.columns))}"
        )


def _build_days(rows: pd.DataFrame) -> list[Any]:
    """Return the day of each row by person; empty if the residual already contains the days."""
    counts = rows.groupby("subject")["day"]
    has_two_rows = rows.duplicated(["subject", "day"]).any()
    if not has_two_rows or int(counts.nunique().max()) < 2:
        return []
    return [pd.get_dummies(days, dtype=float).to_numpy() for _, days in counts]


def _describe_effect(name: str, estimate: float, error: float, freedom: float) -> FixedEffect:
    half = float(stdtrit(freedom, 0.975)) * error
    p_value = 2.0 * float(stdtr(freedom, -abs(estimate) / error))
    return FixedEffect(name, estimate, Interval(estimate - half, estimate + half), p_value)
