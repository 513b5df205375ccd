"""Requests: the value that page, API and command line pass on to the report.

This module does not load ``fusion``, so that a process that only accepts requests stays small.
"""

import json
import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, fields, replace
from typing import Any, Literal

from acromion.fusion.clocks import parse_interval
from acromion.fusion.conventions import HOUR_S, WHOLE_DAY_S, ArmAxis, MethodName, Pose, PoseHeld, Side
from acromion.fusion.diary import DiaryEntry, TaskWindow, parse_clock, plain_word
from acromion.fusion.errors import UnusableDiary

Stage = Literal["preparing", "reading", "checking", "calibrating", "fusing", "counting", "rendering"]
Language = Literal["en", "fr", "fr-CA"]
"""Language of a report; the pages are in English and French."""
ReportKind = Literal["html", "pdf"]
Paper = Literal["a4", "letter"]
OnStage = Callable[[Stage, float], None]


# Control characters, and marks that change the text direction.
_UNPRINTABLE = re.compile(r"[\x00-\x1f\x7f-\x9f\u200e\u200f\u2028-\u202e\u2066-\u2069\ud800-\udfff]")
_LONGEST_NAME = 200
LONGEST_SUBJECT = 100
_NOBODY = frozenset({"n/a", "nan", "null", "none", "unknown", "inconnu", "inconnue"})
SUBJECT_HINT = f"<= {LONGEST_SUBJECT} printable characters"
ISCO_HINT = "ISCO-08: 1-4 digits, 7115"
WINDOW_HINT = "START_S,END_S"
BY_DIARY = "diary"
MAX_DIARY_BYTES = 32 << 20
"""Maximum size of a diary; of a posture per second, it is a week."""
SHIFT_HINT = f"HH:MM-HH:MM|{BY_DIARY}"
SLIP_HINT = "SECONDS"


def clean_file_name(name: str) -> str:
    """Return the last part of a path as one printable line; it is only displayed, never used as a path."""
    last = re.split(r"[/\\]", name)[-1]
    kept = _UNPRINTABLE.sub("", last).strip()
    stem, dot, ending = kept.rpartition(".")
    if len(kept) > _LONGEST_NAME and dot and len(ending) <= 10:
        kept = stem[: _LONGEST_NAME - len(ending) - 1] + dot + ending
    return kept[:_LONGEST_NAME] or "recording"


def clean_folder(path: str) -> str:
    """Return the folders of a path as one printable line, joined by "/"; it is never used as a path."""
    return "/".join(filter(None, re.split(r"[/\\]", _UNPRINTABLE.sub("", path))))[:_LONGEST_NAME]


def check_subject(text: str) -> str:
    """Return a subject code of one printable line, or "" if it names no person. Raises ValueError."""
    if len(text) > LONGEST_SUBJECT or _UNPRINTABLE.search(text):
        raise ValueError(SUBJECT_HINT)
    return find_code(text)


def check_job_title(text: str) -> str:
    """Return a job title of one printable line, without outer spaces. Raises ValueError."""
    if len(text) > LONGEST_SUBJECT or _UNPRINTABLE.search(text):
        raise ValueError(SUBJECT_HINT)
    return text.strip()


def check_isco(text: str) -> str:
    """Return a code of ISCO-08, one to four digits (7 is a major group, 7115 a carpenter), or "".

    The digits are not looked up. Raises ValueError.
    """
    if not re.fullmatch(r"[0-9]{0,4}", text.strip()):
        raise ValueError(ISCO_HINT)
    return text.strip()


def find_code(subject: str) -> str:
    """Return the code that distinguishes people, or "" if it names no person.

    Programs write a missing value as NA, NaN or null, and people write "unknown" or "-". Recordings that
    share such a word are not from one person.
    """
    code = subject.strip()
    is_word = code == "NA" or code.casefold() in _NOBODY
    return "" if is_word or not any(sign.isalnum() for sign in code) else code


SIDES: Mapping[str, Side] = {
    "left": "left", "l": "left", "gauche": "left", "g": "left",
    "right": "right", "r": "right", "droit": "right", "droite": "right", "d": "right",
}  # fmt: skip
"""Words for an arm, as :func:`acromion.fusion.diary.plain_word` returns them."""

_CODE = re.compile(r"[a-z]{1,4}\d{1,4}", re.IGNORECASE)
_NOT_A_PERSON = re.compile(
    r"(adl|ax|cwa|csv|d|day|dot|exp|file|gt|gt3x|hz|imu|j|jour|log|lsm|mac|mt|mtw|rec|run|sd|sess|t|task|test|"
    r"v|w|week|x|xio)\d+",
    re.IGNORECASE,
)
_WITH_ARM = re.compile(rf"(?<![^\W_])({_CODE.pattern})({'|'.join(SIDES)})(?![^\W_])", re.IGNORECASE)
_ENDING = re.compile(r"(\.[a-z0-9]{2,7})+$", re.IGNORECASE)
_LABELS = frozenset({"id", "participant", "patient", "person", "personne", "sub", "subj", "subject", "sujet"})


@dataclass(frozen=True, slots=True)
class Proposal:
    """The subject code and arm that a file name suggests, "" and None if unclear."""

    subject: str = ""
    side: Side | None = None


def propose_description(path: str) -> Proposal:
    """Return the subject and arm that the name of a file and its folders suggest.

    ``P01_right.gt3x``, ``P01R.gt3x`` and ``P01/right/shift.gt3x`` suggest P01 and the right arm. A code is up
    to four letters and up to four digits, the first in a name, or the word after "sub", "participant",
    "sujet", ... Codes of devices, days and tasks ("ax6", "day2") do not count. A single letter is an arm
    only after a code or as a whole name: "dps_g" is a unit. If a folder and the file suggest two people, or
    if both arms are named, nothing is suggested. A person confirms every proposal before it is used.
    """
    subjects, sides = list[str](), set[Side]()
    for part in re.split(r"[/\\]", _ENDING.sub("", path)):
        words = re.findall(r"[^\s_.,()-]+", _WITH_ARM.sub(r"\1 \2", part))
        pairs = list(zip(["", *words], words, strict=False))
        labelled = [
            f"{label}-{word}" if word.isdecimal() else word
            for label, word in pairs
            if label.casefold() in _LABELS and any(sign.isdecimal() for sign in word)
        ]
        codes = [word for word in words if _CODE.fullmatch(word) and not _NOT_A_PERSON.fullmatch(word)]
        subjects += (labelled or codes)[:1]
        for before, word in pairs:
            is_placed = len(word) > 1 or len(words) == 1 or before[-1:].isdecimal()
            if is_placed and plain_word(word) in SIDES:
                sides.add(SIDES[plain_word(word)])
    is_one = len({subject.casefold() for subject in subjects}) == 1
    return Proposal(subjects[0] if is_one else "", sides.pop() if len(sides) == 1 else None)


def parse_window(text: str) -> tuple[float, float]:
    """Parse ``START_S,END_S``. Raises ValueError."""
    start_s, end_s = (float(part) for part in text.split(","))
    if not 0 <= start_s < end_s < math.inf:
        raise ValueError(WINDOW_HINT)
    return start_s, end_s


def check_hours(text: str) -> str:
    """Return hours as ``07:00-15:30``, or "diary". Raises ValueError."""
    if text == BY_DIARY:
        return text
    try:
        start, end = (parse_clock(part) for part in re.split(r"[-–]", text))
    except UnusableDiary:
        raise ValueError(SHIFT_HINT) from None
    if "T" in start + end or start == end:
        raise ValueError(SHIFT_HINT)
    return f"{start}-{end}"


def check_interval(text: str) -> str:
    """Return the window of a shift as an interval of ISO 8601. Raises ValueError."""
    return str(parse_interval(text))


def check_shift(text: str) -> str:
    """Return "" or a shift as an interval, as hours of each day, or "diary". Raises ValueError."""
    if not text:
        return ""
    return check_interval(text) if "/" in text else check_hours(text)


def find_window_hint(pose: Pose, window_count: int, arm_axis: ArmAxis | None) -> str:
    """Return the allowed number of calibration windows if ``window_count`` is not allowed; else "".

    A stated axis replaces the pose, so no window is allowed. "two-point" needs two windows; any other pose
    accepts any number.
    """
    if arm_axis is not None:
        return f"axis: 0 x {WINDOW_HINT}" if window_count else ""
    return f"two-point: 2 x {WINDOW_HINT}" if pose == "two-point" and window_count != 2 else ""


def parse_slip_time(text: str) -> float:
    """Parse a time in seconds at which the sensor slipped, or did not. Raises ValueError."""
    time_s = float(text)
    if not 0 <= time_s < math.inf:
        raise ValueError(SLIP_HINT)
    return time_s


def write_profile(values: Mapping[str, Any]) -> str:
    """Return a column profile as JSON for a request, without its name and its empty values.

    The name of the profile therefore does not affect the setting.
    """
    stated = {
        name: value for name, value in values.items() if value not in (None, "", (), []) and name != "name"
    }
    for name in ("acceleration_factor", "angular_rate_factor", "rate_hz"):
        if isinstance(stated.get(name), int):
            stated[name] = float(stated[name])
    return json.dumps(stated, sort_keys=True)


@dataclass(frozen=True, slots=True)
class Reference:
    """The reference of a comparison: a stored file, and what the person states about the two recordings.

    ``offset_s`` and ``drift_ppm``: clock of the reference, if set by hand; ``rate_hz``: sampling rate of a
    reference without timestamps.
    """

    path: str
    file_name: str
    offset_s: float | None = None
    drift_ppm: float | None = None
    rate_hz: float | None = None
    tasks: tuple[TaskWindow, ...] = ()


LONGEST_CONCLUSION = 1000
LABEL = frozenset(
    {
        *(
            "subject",
            "side",
            "job_title",
            "isco_code",
            "conclusion",
            "draft",
            "version",
            "changes",
            "reason",
        ),
        *("languages", "kinds", "paper", "appendix", "min_hours"),
    }
)
"""Fields of a request that name the person, arm and wording of a report; they affect no figure."""


MIN_HOURS = WHOLE_DAY_S / HOUR_S
"""The least analysed time of a day that counts, unless a person states another."""


@dataclass(frozen=True, slots=True)
class Conclusion:
    """A clinician's conclusion on a report: typed by a person, with name and date (``2026-11-23``)."""

    text: str
    name: str
    date: str


@dataclass(frozen=True, slots=True)
class ConclusionDraft:
    """An earlier conclusion that has not been confirmed since a correction; no report prints it.

    ``version``: the version it was written for; ``changes``: the settings that have changed since then, and
    "engine" for another version of the software. Without changes the figures are the same.
    """

    conclusion: Conclusion
    version: int
    changes: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class ReportRequest:
    """All settings of a report.

    ``source``: the file contains samples or computed angles; ``profile``: JSON of a column profile
    (:class:`acromion.fusion.readers.ColumnProfile`), "" for none; ``joined``: paths of further files of the
    same shift (command line only). ``calibration_windows_s``: when the pose was held, once or more;
    ``pose_held``:
    "start" if it was held at the start of wear, "no" if the file's statement about it is wrong; ``arm_axis``:
    the sensor's axis along the arm, if no pose was held; ``slip_times_s``: when the sensor slipped, as the
    person states, ``no_slip_times_s``: when it did not. ``version`` counts the reports of one recording.
    ``changes`` lists the differences from the previous report (a setting, "input" or "engine"); ``reason`` is
    the person's reason. ``shift``: the window of clock time to analyse, as an interval of ISO 8601, of a
    recording of several days; "" for all; all seconds then count from the first sample in the window. In
    the settings of a run it may also be hours (``07:00-15:30``) or "diary", which cut every recording.
    ``pose_from``: an earlier shift whose pose applies, because a person states that the sensor was not
    removed, and ``pose_from_windows_s``: when it was held there; empty if at its start;
    ``pose_from_no_slip_at_s``: when the sensor did not slip there. ``conclusion``
    applies to these figures only; after a correction it becomes a ``draft``. ``appendix``: the PDF has
    its appendix. ``time_zone``: the zone of clock times, "" for that of the file; ``clock_offset_s``: seconds
    to add to the device's clock. ``job_title``, ``isco_code``: the person's job, and its code of ISCO-08.
    ``min_hours``: the least analysed time of a day that counts in the tables of a run.

    With a ``reference``, the request is for a comparison instead of a report.
    """

    file_name: str
    subject: str = ""
    side: Side | None = None
    method: MethodName = "smoothed"
    pose: Pose = "n-pose"
    calibration_windows_s: tuple[tuple[float, float], ...] = ()
    rate_hz: float | None = None
    languages: tuple[Language, ...] = ("en", "fr")
    kinds: tuple[ReportKind, ...] = ("html", "pdf")
    paper: Paper = "a4"
    source: Literal["samples", "angles"] = "samples"
    diary: tuple[DiaryEntry, ...] = ()
    profile: str = ""
    joined: tuple[str, ...] = ()
    version: int = 1
    changes: tuple[str, ...] = ()
    reason: str = ""
    reference: Reference | None = None
    arm_axis: ArmAxis | None = None
    slip_times_s: tuple[float, ...] = ()
    conclusion: Conclusion | None = None
    no_slip_times_s: tuple[float, ...] = ()
    pose_held: PoseHeld | None = None
    draft: ConclusionDraft | None = None
    appendix: bool = False
    shift: str = ""
    pose_from: str = ""
    pose_from_windows_s: tuple[tuple[float, float], ...] = ()
    pose_from_no_slip_at_s: tuple[float, ...] = ()
    time_zone: str = ""
    clock_offset_s: float = 0.0
    job_title: str = ""
    isco_code: str = ""
    min_hours: float = MIN_HOURS

    def to_json(self) -> str:
        """Return the request as text for a job row or a settings hash."""
        return json.dumps(asdict(self), sort_keys=True)

    @classmethod
    def from_json(cls, text: str) -> "ReportRequest":
        """Parse the text of :meth:`to_json`; unknown names are ignored."""
        known = {field.name for field in fields(cls)}
        values = {name: value for name, value in json.loads(text).items() if name in known}
        windows, earlier = (
            tuple((float(a), float(b)) for a, b in values.pop(name, ()))
            for name in ("calibration_windows_s", "pose_from_windows_s")
        )
        diary = tuple(DiaryEntry(**entry) for entry in values.pop("diary", ()))
        times = ("slip_times_s", "no_slip_times_s", "pose_from_no_slip_at_s")
        for name in ("languages", "kinds", "joined", "changes", *times):
            if name in values:
                values[name] = tuple(values[name])
        if reference := values.pop("reference", None):
            tasks = tuple(TaskWindow(**task) for task in reference.pop("tasks", ()))
            values["reference"] = Reference(tasks=tasks, **reference)
        if concluded := values.pop("conclusion", None):
            values["conclusion"] = Conclusion(**concluded)
        if draft := values.pop("draft", None):
            changes = tuple(draft["changes"])
            values["draft"] = ConclusionDraft(Conclusion(**draft["conclusion"]), draft["version"], changes)
        return cls(calibration_windows_s=windows, pose_from_windows_s=earlier, diary=diary, **values)

    def describe_settings(self) -> dict[str, object]:
        """Return the settings that distinguish versions, without languages and output formats."""
        ignored = {"file_name", "languages", "kinds", "paper", "appendix", "joined"}
        ignored |= {"version", "changes", "reason", "draft", "min_hours"}
        return {name: value for name, value in asdict(self).items() if name not in ignored}

    def describe_figures(self, *, is_capture: bool) -> dict[str, object]:
        """Return the settings that affect the figures; all others are its label (:data:`LABEL`).

        ``is_capture``: the file is a motion capture. It may contain both arms, and the arm then also counts.
        Of the diary only the rows of this recording count.
        """
        label = LABEL - {"side"} if is_capture else LABEL
        figures = {name: value for name, value in asdict(self).items() if name not in label}
        return figures | {"diary": [asdict(entry) for entry in self.select_diary()]}

    def list_deferred(self) -> tuple[str, ...]:
        """Return the files that are made on request, and not when only the label changes.

        They are the PDFs in languages other than the first, and FHIR, which contains every PDF: typesetting
        takes three quarters of the time of such a change.
        """
        others = [f"report.{language}.pdf" for language in self.languages[1:]]
        return ("fhir.json", *others) if others and "pdf" in self.kinds and self.reference is None else ()

    def select_diary(self) -> tuple[DiaryEntry, ...]:
        """Return the diary rows of this file, matched by full name, stem or subject."""
        names = {"", self.file_name, self.file_name.partition(".")[0], self.subject}
        return tuple(entry for entry in self.diary if entry.file in names)

    def choose_rows(self, diary: Sequence[DiaryEntry]) -> tuple[DiaryEntry, ...]:
        """Return the rows of a diary that are for this file. Raises UnusableDiary: there are none."""
        chosen = replace(self, diary=tuple(diary)).select_diary()
        if diary and not chosen:
            first = diary[0]
            raise UnusableDiary(
                line=first.line, why="other recordings", cure="other recordings", value=first.file
            )
        return chosen


PairKind = Literal["pair", "compare"]
LONGEST_OFFSET_S = 172_800
"""Two days: clocks of one shift that differ by more were never set."""


PairClockSource = Literal["devices", "signals"]


@dataclass(frozen=True, slots=True)
class PairRequest:
    """All settings of a report on two finished analyses.

    ``kind``: "pair" puts both arms of one shift on one clock; "compare" compares a day with an earlier one.
    ``offset_s``: start of the right arm's recording, in seconds after the left arm's; ``trunk_offset_s``: the
    same for the trunk. None uses ``clock``: the clocks of the devices, or the movement that both share.
    ``same_subject``: the person states that all recordings are from one person, if a subject code is missing.
    ``mixed_methods``: allow figures of two methods, or of two versions of one.
    """

    kind: PairKind
    offset_s: float | None = None
    trunk_offset_s: float | None = None
    languages: tuple[Language, ...] = ("en", "fr")
    kinds: tuple[ReportKind, ...] = ("html", "pdf")
    paper: Paper = "a4"
    same_subject: bool = False
    mixed_methods: bool = False
    clock: PairClockSource = "devices"

    @property
    def figures_name(self) -> str:
        """Name of the JSON file with the figures."""
        return "pair.json" if self.kind == "pair" else "comparison.json"


@dataclass(frozen=True, slots=True)
class ProfileRequest:
    """All settings of a report on several finished analyses.

    ``before_count``: the number of analyses, from the first, that are before a change; None without a change.
    ``min_hours``: the least analysed time of a day that counts. ``same_subject`` and ``mixed_methods``: see
    :class:`PairRequest`. ``has_drawings``: also write the charts
    separately as ``drawings.<language>.json`` for the page.
    """

    before_count: int | None = None
    languages: tuple[Language, ...] = ("en", "fr")
    kinds: tuple[ReportKind, ...] = ("html", "pdf")
    paper: Paper = "a4"
    same_subject: bool = False
    mixed_methods: bool = False
    has_drawings: bool = False
    min_hours: float = MIN_HOURS

    @property
    def kind(self) -> str:
        """Kind of report, as :attr:`PairRequest.kind`."""
        return "profile"

    @property
    def figures_name(self) -> str:
        """Name of the JSON file with the figures."""
        return "profile.json"


def compare_settings(before: Mapping[str, object], after: Mapping[str, object]) -> tuple[str, ...]:
    """Return the names of the settings that differ; see :meth:`ReportRequest.describe_settings`."""
    return tuple(name for name in after if name in before and before[name] != after[name])
