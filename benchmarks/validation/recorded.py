"""Sections (b) and (c): BROAD as recorded, and BROAD under stress."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np

from benchmarks.validation.document import Goal, Section, draw_table, judge
from benchmarks.validation.peers import BIAS_ONLY, ON_BROAD_ONLY, QUICK, RAISED_CLIP_DPS
from tests.validation.broad import (
    Estimator,
    Score,
    Trial,
    add_offset,
    cut_rest,
    load_trials,
    resample_to_100_hz,
    score,
)

Scores = dict[str, Score]
Dataset = dict[str, list[Trial]]
SMALL_OFFSET_DPS = np.array([3.0, -5.0, 4.0])
CLIPPED_G, CLIPPED_DPS = 2.0, 500.0
WORSE_BY_DEG = 0.02
GROUPS: Mapping[str, tuple[str, ...]] = {
    "slow rotation": ("02", "04"),
    "fast rotation": ("06", "08"),
    "slow translation": ("10", "12", "14"),
    "fast translation": ("16", "18"),
    "fast combined": ("21",),
    "tapping, vibration": ("24", "26"),
    "near magnets": ("28", "30", "32", "34", "36"),
}

BROAD_PROSE = f"""\
Data: the project's 17 trials of BROAD (Laidig, Caruso, Cereatti, Seel, 2021, CC BY 4.0), acceleration and
angular rate only. The error of a trial is the root mean square angle between the estimated and the optical
vertical over the moving phase; a score is the mean over trials. *Raw*: sample by sample. *Aligned*: the truth
is shifted by one constant lag for all trials, the best of a 0.5 ms grid for each estimator and rate (BROAD's
truth leads its sensors by about 3.8 ms, and rectangular integration hides part of that). 100 Hz is 7/20 of
285.7 Hz by a polyphase filter.

*Even* and *odd* are every second trial in order of name. `smoothed` and `live` were tuned on the even half;
the odd half was seen while two parameters were chosen, so it is not blind. The peers run with their defaults:
offlineVQF and VQF (and offlineVQF also with its bias clip raised from 2 to {RAISED_CLIP_DPS:.0f} deg/s),
Madgwick and Mahony of `ahrs` with their default gains, imufusion with its bias estimator, a range of 2000
deg/s and rejection of acceleration that is off by more than 10 deg for up to 5 s. *{BIAS_ONLY}* is our
estimator without the correction of accelerometer and gyroscope scale from the recording itself; if both agree
to the last digit, no correction was applied."""

STRESS_PROSE = f"""\
The same trials with changes; one configuration of each estimator for all cases. *Offset*: added to all three
axes of the gyroscope. *No rest*: cut from the first movement to the last. *Clipped*: both sensors clipped at
{CLIPPED_G:.0f} g and {CLIPPED_DPS:.0f} deg/s. Madgwick and Mahony of `ahrs` take minutes for each case and
are omitted. Degrees, aligned as above, raw in brackets."""


def offset_a_little(trial: Trial) -> Trial:
    return replace(trial, gyr_dps=trial.gyr_dps + SMALL_OFFSET_DPS)


def clip_both(trial: Trial) -> Trial:
    acc_g = np.clip(trial.acc_g, -CLIPPED_G, CLIPPED_G)
    return replace(trial, acc_g=acc_g, gyr_dps=np.clip(trial.gyr_dps, -CLIPPED_DPS, CLIPPED_DPS))


CASES: Mapping[str, Callable[[Trial], Trial]] = {
    "offset +3, -5, +4 deg/s": offset_a_little,
    "offset +10, -20, +15 deg/s": add_offset,
    "no rest": cut_rest,
    "offset +10, -20, +15 and no rest": lambda trial: add_offset(cut_rest(trial)),
    "clipped at 2 g and 500 deg/s": clip_both,
}
LIMITED = tuple(CASES)[:4]


@cache
def load_both(folder: Path) -> Dataset:
    trials = load_trials(folder)
    return {"286 Hz": trials, "100 Hz": [resample_to_100_hz(trial) for trial in trials]}


def score_all(trials: Sequence[Trial], estimators: Mapping[str, Estimator]) -> Scores:
    return {name: score(trials, estimate) for name, estimate in estimators.items()}


@cache
def score_untouched(folder: Path, rate: str) -> Scores:
    return score_all(load_both(folder)[rate], QUICK)


def compare_on_broad(folder: Path) -> Section:
    dataset = load_both(folder)
    scores = {
        rate: score_untouched(folder, rate) | score_all(trials, ON_BROAD_ONLY)
        for rate, trials in dataset.items()
    }
    names = [trial.name for trial in dataset["286 Hz"]]
    paragraphs = [BROAD_PROSE, _draw_totals(scores)]
    for rate, by_name in scores.items():
        paragraphs += [f"### {rate}, by group and trial, aligned, degrees", _draw_groups(by_name, names)]
        paragraphs.append(_draw_trials(by_name, names))
    return Section(
        "BROAD, 17 trials against optical motion capture", (), _judge_broad(scores), tuple(paragraphs)
    )


def stress(folder: Path) -> Section:
    dataset = load_both(folder)
    untouched = {rate: score_untouched(folder, rate) for rate in dataset}
    stressed = {
        rate: {case: score_all([change(trial) for trial in trials], QUICK) for case, change in CASES.items()}
        for rate, trials in dataset.items()
    }
    paragraphs = [STRESS_PROSE]
    for rate, cases in stressed.items():
        paragraphs += [f"### {rate}", _draw_cases({"untouched": untouched[rate]} | cases)]
    goals = [
        _judge_case(rate, case, scores["smoothed"], untouched[rate]["offlineVQF"])
        for rate, cases in stressed.items()
        for case, scores in cases.items()
        if case in LIMITED
    ]
    return Section("BROAD with an offset or without rest", (), tuple(goals), tuple(paragraphs))


def _draw_totals(scores: Mapping[str, Scores]) -> str:
    rows = [
        [
            name,
            rate,
            f"{s.raw_deg:.3f}",
            f"{s.aligned_deg:.3f}",
            f"{1e3 * s.lag_s:+.1f}",
            f"{s.even_deg:.3f}",
            f"{s.odd_deg:.3f}",
            f"{s.trials_deg.max():.3f}",
        ]
        for rate, by_name in scores.items()
        for name, s in by_name.items()
    ]
    return draw_table(("estimator", "rate", "raw", "aligned", "lag ms", "even", "odd", "worst trial"), rows)


def _draw_groups(by_name: Scores, names: Sequence[str]) -> str:
    rows = []
    for group, numbers in GROUPS.items():
        chosen = [k for k, name in enumerate(names) if name[:2] in numbers]
        means = [f"{s.trials_deg[chosen].mean():.2f}" for s in by_name.values()]
        rows.append([f"{group} ({len(chosen)})", *means])
    return draw_table(("group (trials)", *by_name), rows)


def _draw_trials(by_name: Scores, names: Sequence[str]) -> str:
    rows = [[name, *(f"{s.trials_deg[k]:.2f}" for s in by_name.values())] for k, name in enumerate(names)]
    return draw_table(("trial", *by_name), rows)


def _draw_cases(cases: Mapping[str, Scores]) -> str:
    rows = [
        [case, *(f"{s.aligned_deg:.3f} ({s.raw_deg:.3f})" for s in scores.values())]
        for case, scores in cases.items()
    ]
    return draw_table(("case", *QUICK), rows)


def _judge_broad(scores: Mapping[str, Scores]) -> tuple[Goal, ...]:
    goals = []
    for rate, by_name in scores.items():
        peer = by_name["offlineVQF"].aligned_deg
        what = f"BROAD, {rate}, aligned: `smoothed` within 0.02 deg of offlineVQF ({peer:.3f})"
        goals.append(judge(what, by_name["smoothed"].aligned_deg, round(peer + 0.02, 3)))
        causal = by_name["VQF"].aligned_deg
        what = f"BROAD, {rate}, aligned: `live` no worse than real-time VQF"
        goals.append(judge(what, by_name["live"].aligned_deg, round(causal, 3)))
        worse = by_name["smoothed"].trials_deg - by_name[BIAS_ONLY].trials_deg
        what = f"BROAD, {rate}: the trial that self-calibration makes worst, against bias only"
        goals.append(judge(what, float(worse.max()), WORSE_BY_DEG))
    return tuple(goals)


def _judge_case(rate: str, case: str, ours: Score, peer: Score) -> Goal:
    what = f"{case}, {rate}: `smoothed` within 0.03 deg of offlineVQF untouched ({peer.aligned_deg:.3f})"
    return judge(what, ours.aligned_deg, round(peer.aligned_deg + 0.03, 3))
