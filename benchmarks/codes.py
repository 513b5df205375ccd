"""Write every code with its title, outcome and facts as docs/reference/codes.md."""

from collections.abc import Iterator, Mapping
from math import isfinite

from acromion.app.errors import (
    CANCELLED,
    NO_RECORDING,
    NO_RESULTS,
    NO_SHARDS,
    REFUSED_BY_THE_SCIENCE,
    RESULTS_IN_USE,
    UNREADABLE_PATH,
    AppError,
    find_outcome,
    list_refusals,
)
from acromion.app.report.words.messages import describe_flag, describe_problem
from acromion.fusion.caveats import Caveat, Grade
from acromion.fusion.errors import DOUBLE_RECORDING, FusionError
from acromion.fusion.recording import QualityFlag

PAGE = """Made from the code: `python -m benchmarks.reference`

# Codes

The titles are the English ones. The page `/problems/CODE` of a server and `GET /api/v1/problems/CODE` explain
each code in full, in both languages.

## Caveats

A caveat says what to know about a figure. Caveats are declared in `fusion/caveats.py`. A note leaves the
verdict good; a caution or a poor lowers it to that grade.

| code | title | counts as | facts |
|---|---|---|---|
{caveats}

## File errors

The file gives no figures. These refusals are declared in `fusion/errors.py`; HTTP status {status}, exit code
{exit_code}. Besides its own facts, a refusal may have `line`, `byte` and `clock`: the place in the file.

| code | title | facts |
|---|---|---|
{refusals}

## Other refusals

Refusals of uploads, requests, the server and the analysis, declared in `app/errors.py`. "Again": a retry may
help.

| code | title | HTTP | exit | again | facts |
|---|---|---|---|---|---|
{others}

## Codes of the command line and of a batch

Shown beside a file, never raised: {bare}.
"""


def write_document() -> str:
    """Return the page."""
    refusals = list_refusals()
    return PAGE.format(
        status=REFUSED_BY_THE_SCIENCE.status,
        exit_code=REFUSED_BY_THE_SCIENCE.exit_code,
        caveats="\n".join(_describe_caveat(caveat) for caveat in Caveat),
        refusals="\n".join(_describe_refusals(refusals)),
        others="\n".join(_describe_others(refusals)),
        bare=", ".join(
            f"`{code}` ({describe_problem(code, {}, 'en').title})"
            for code in (
                UNREADABLE_PATH,
                NO_RECORDING,
                NO_SHARDS,
                NO_RESULTS,
                RESULTS_IN_USE,
                DOUBLE_RECORDING,
                CANCELLED,
            )
        ),
    )


def _describe_caveat(caveat: Caveat) -> str:
    title = describe_flag(QualityFlag(caveat), "en").title
    return f"| `{caveat}` | {title} | {_describe_grade(caveat)} | {_describe_facts(caveat.fact_meanings)} |"


def _describe_grade(caveat: Caveat) -> str:
    usual, share = caveat.grade.name.lower(), caveat.limit.from_share
    if not isfinite(share):
        return usual
    return f"{usual}; {Grade(caveat.grade + 1).name.lower()} from {100 * share:g} % of the recorded time"


def _describe_refusals(refusals: tuple[type[FusionError] | type[AppError], ...]) -> Iterator[str]:
    for kind in refusals:
        if issubclass(kind, FusionError):
            title = describe_problem(kind.code, {}, "en").title
            yield f"| `{kind.code}` | {title} | {_describe_facts(find_own_facts(kind))} |"


def _describe_others(refusals: tuple[type[FusionError] | type[AppError], ...]) -> Iterator[str]:
    for kind in refusals:
        if issubclass(kind, AppError):
            title, outcome = describe_problem(kind.code, {}, "en").title, find_outcome(kind)
            again = "yes" if outcome.retryable else "no"
            facts = _describe_facts(find_own_facts(kind))
            yield f"| `{kind.code}` | {title} | {outcome.status} | {outcome.exit_code} | {again} | {facts} |"


def find_own_facts(kind: type[FusionError] | type[AppError]) -> Mapping[str, str]:
    """Return the facts that a class declares itself; without those of its parent."""
    own: Mapping[str, str] = vars(kind).get("fact_meanings", {})
    return own


def _describe_facts(meanings: Mapping[str, str]) -> str:
    return "; ".join(f"`{name}`: {meaning}" for name, meaning in meanings.items())
