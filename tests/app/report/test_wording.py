"""Every code has words in both languages, and the languages hold the same keys."""

import re
import tomllib
from collections.abc import Iterator, Mapping
from datetime import UTC, date, datetime
from typing import Any, get_args
from zoneinfo import ZoneInfo

import pytest

from acromion.app.report.words.messages import describe_flag, describe_problem
from acromion.app.report.words.numbers import (
    Clock,
    format_angle,
    format_clock,
    format_date,
    format_duration,
    format_duration_range,
    format_elapsed,
    format_exact,
    format_hour,
    format_long_duration,
    format_number,
    format_percent,
    format_rate,
)
from acromion.app.report.words.wording import (
    LANGUAGES,
    Language,
    Part,
    apply_typography,
    fill,
    find_nearest,
    load_wording,
)
from acromion.fusion.exposure.types import Interval
from acromion.fusion.recording import QualityFlag
from tests import ROOT
from tests.app.report.report_reading import plain

SOURCE = " ".join(path.read_text() for folder in ("fusion", "app") for path in (ROOT / folder).rglob("*.py"))
UNFIT_WORDS = r"\b(risk|risky|safe|unsafe|abnormal|dangerous posture|risque|risqué|sûre?s?|anormale?)\b"


def walk_texts(value: Any, path: str = "") -> Iterator[tuple[str, str]]:
    if isinstance(value, Mapping):
        for key, inner in value.items():
            yield from walk_texts(inner, f"{path}.{key}")
    elif isinstance(value, list):
        for rank, inner in enumerate(value):
            yield from walk_texts(inner, f"{path}.{rank}")
    else:
        yield path, value


@pytest.mark.parametrize("part", [None, *get_args(Part)])
def test_both_languages_hold_the_same_texts_with_the_same_placeholders(part: Part | None) -> None:
    english, french = (
        {
            path: set(re.findall(r"\{\w+\}", text))
            for path, text in walk_texts(load_wording(language, part) if part else load_wording(language))
        }
        for language in LANGUAGES
    )

    assert english == french


def test_no_text_is_empty() -> None:
    empty = [path for language in LANGUAGES for path, text in walk_texts(load_wording(language)) if not text]

    assert empty == []


@pytest.mark.parametrize("language", LANGUAGES)
@pytest.mark.parametrize("part", get_args(Part))
def test_a_part_read_alone_is_what_it_is_in_the_whole_file(language: Language, part: Part) -> None:
    whole = tomllib.loads((ROOT / "app" / "report" / "words" / f"{language}.toml").read_text("utf-8"))

    texts = walk_texts(load_wording(language, part))

    assert [path for path, _ in texts] == [path for path, _ in walk_texts(whole[part])]


@pytest.mark.parametrize("language", LANGUAGES)
def test_every_code_has_title_and_detail_and_a_refusal_its_cure(language: Language) -> None:
    words = load_wording(language)["problem"] | load_wording(language)["flag"]
    codes = set(re.findall(r'"([EW]-[A-Z0-9][A-Z0-9-]+)"', SOURCE))

    parts = {code: set(words.get(code, {})) - {"general"} for code in codes}

    of_lists = {"E-AGAIN", "E-DIARY", "E-PARTICIPANTS", "E-POSTURE"}
    told = {code: {"title", "detail"} | ({"fix"} if code.startswith("E") else set()) for code in codes}
    assert parts == told | {code: {"title", "detail", "fix", "another", "more"} for code in of_lists}


@pytest.mark.parametrize("language", LANGUAGES)
def test_a_refusal_without_facts_shows_no_brace_and_no_bracket(language: Language) -> None:
    told = [describe_problem(code, {}, language) for code in load_wording(language)["problem"]]

    texts = " ".join(f"{p.title} {p.detail} {p.fix}" for p in told)

    assert not set(texts) & set("{}[]")


@pytest.mark.parametrize("language", LANGUAGES)
@pytest.mark.parametrize("kind", ["problem", "flag"])
def test_a_sentence_about_a_code_in_general_names_no_case(language: Language, kind: str) -> None:
    entries = [entry for entry in load_wording(language)[kind].values() if "general" in entry]

    assert entries
    assert [entry["general"] for entry in entries if "{" in entry["general"]] == []


def test_a_code_without_a_case_is_told_in_general() -> None:
    assert describe_problem("E-STUDY", {}, "en").detail == (
        "The folder is not arranged as a study of agreement. The message names what is missing."
    )


@pytest.mark.parametrize("language", LANGUAGES)
def test_no_text_judges(language: Language) -> None:
    judged = [
        (path, text)
        for path, text in walk_texts(load_wording(language))
        if re.search(UNFIT_WORDS, text, re.IGNORECASE) and not path.startswith((".flag", ".problem"))
    ]

    assert judged == []


@pytest.mark.parametrize("language", LANGUAGES)
@pytest.mark.parametrize("fact", ["why", "reason", "what", "evidence"])
def test_every_fixed_term_that_the_science_gives_as_a_fact_has_words(fact: str, language: Language) -> None:
    science = " ".join(path.read_text() for path in (ROOT / "fusion").rglob("*.py"))
    terms = set(re.findall(rf'(?:\b{fact}=|"{fact}": )"([\w -]+)"', science))

    assert terms - set(load_wording(language)["fact"][fact]) == set()


def test_facts_stand_in_the_sentence_and_the_place_beside_it() -> None:
    problem = describe_problem("E-ROW", {"k": 1200, "line": 37}, "en")

    assert (problem.detail, problem.where) == (
        "1\u202f200\u00a0lines could not be read, more than 5\u202f%; the first is line 37.",
        "line 37",
    )


def test_a_part_of_a_sentence_whose_fact_is_unknown_is_left_out() -> None:
    assert fill("Refused[: {reason}].", {}) == "Refused."


def test_a_fixed_term_of_the_code_is_told_in_the_language() -> None:
    problem = describe_problem("E-ZIP-UNSAFE", {"reason": "encrypted"}, "fr")

    assert problem.detail == "L’archive n’a pas été ouverte\u00a0: elle est chiffrée."


def test_facts_from_a_file_are_only_text() -> None:
    problem = describe_problem("E-COLS", {"list": "{x} [y] <b>\u202e"}, "en")

    assert problem.detail == (
        "Not all columns of acceleration (ax, ay, az) and angular rate (gx, gy, gz) were recognised. "
        "The header line reads: {x} [y] <b>"
    )


def test_an_unknown_code_is_an_error_of_the_software_or_shows_itself() -> None:
    assert describe_problem("E-NEW", {}, "en").title == "Software error"
    assert describe_flag(QualityFlag("W-NEW"), "fr").title == "W-NEW"


@pytest.mark.parametrize(
    ("language", "told"),
    [
        ("en", "A (5\u202f%): 20\u00a0h; yes?"),
        ("fr", "«\u00a0L’arc\u00a0»\u00a0: 5\u00a0%\u202f; oui\u202f? non\u202f!"),
        ("fr-CA", "«\u00a0L’arc\u00a0»\u00a0: 5\u00a0%; oui? non!"),
    ],
)
def test_each_language_has_its_own_spaces_before_punctuation(language: Language, told: str) -> None:
    typed = "A (5 %): 20 h; yes?" if language == "en" else "« L'arc » : 5 % ; oui ? non !"

    assert apply_typography(typed, language) == told


def test_quebec_says_quart_where_france_says_poste() -> None:
    assert apply_typography("Poste : la moitié du poste, deux postes à poste fixe", "fr-CA") == (
        "Quart\u00a0: la moitié du quart, deux quarts à quart fixe"
    )


def walk_french(language: Language) -> Iterator[str]:
    """Every text of people in a French: the meanings of columns are read by programs and stay as typed."""
    for part in get_args(Part):
        if part != "tables":
            yield from (text for _, text in walk_texts(load_wording(language, part)))


def test_no_french_text_of_france_has_a_plain_space_before_its_punctuation_or_a_quart() -> None:
    wrong = r" [;:!?%»]|« |[^\s\u202f][;!?](?=\s)|\u202f[:%»]|\bquarts?\b(?! d)"

    assert [text for text in walk_french("fr") if re.search(wrong, text)] == []


def test_no_french_text_of_quebec_has_a_space_before_a_semicolon_or_a_poste() -> None:
    wrong = r"\s[;!?]|« | [:%»]|\u202f[:%»]|\bpostes?\b"

    assert [text for text in walk_french("fr-CA") if re.search(wrong, text, re.IGNORECASE)] == []


CODE = (
    r"\w+://\S+",
    r"(?<!\d)\d{1,2}:\d\d(?::\d\d)?|\bhh:mm\b|\bh:min:s\b",
    r"\bAuthorization: Bearer\b|\bTus-Resumable: [\d.]+|\bnom: valeur\b|# \w+: [\w,-]+",
    r"\b\d{4};\d+:\d+\b",
)
"""Addresses, times, headers and settings, and a journal's volume: their signs are not punctuation."""


def find_wrong_spaces(text: str, before: Mapping[str, str]) -> list[str]:
    """Return each ``; ! ? :`` of a French text with the wrong space before it, and what precedes it."""
    text = re.sub("|".join(CODE), "CODE", text)
    text = re.sub(r"\{\w+(?::\w+)?\|[^{}]*\}", "FORM", text)
    return [
        found[0]
        for found in re.finditer(r"(?:^|[^\s\[]?)(\s*)([;!?:])", text)
        if found[1] != before[found[2]] and found[0] != found[2]
    ]


@pytest.mark.parametrize("part", get_args(Part))
def test_every_french_text_is_typed_with_one_space_before_its_punctuation(part: Part) -> None:
    words = tomllib.loads((ROOT / "app" / "report" / "words" / "fr.toml").read_text("utf-8"))[part]

    typed = [(path, text.replace("\u00a0", " ")) for path, text in walk_texts(words)]
    wrong = [(path, find_wrong_spaces(text, dict.fromkeys(";!?:", " "))) for path, text in typed]

    assert [finding for finding in wrong if finding[1]] == []


@pytest.mark.parametrize(("language", "narrow"), [("fr", "\u202f"), ("fr-CA", "")])
def test_every_french_text_is_shown_with_the_spaces_of_its_country(language: Language, narrow: str) -> None:
    before = dict.fromkeys(";!?", narrow) | {":": "\u00a0"}

    wrong = [(text, find_wrong_spaces(text, before)) for text in walk_french(language)]

    assert [finding for finding in wrong if finding[1]] == []


@pytest.mark.parametrize(
    ("text", "wrong"),
    [
        ("La pose: tenue ?", ["e:"]),
        ("Quand? à 10:20, sur http://a.b", ["d?"]),
        ("2026-03-02T08:00:00.010-05:00", []),
        ("deux  ; trois", ["x  ;"]),
        ("[ ; {more} de plus]", []),
        ("Bioengineering 2025;12:50", []),
    ],
)
def test_a_wrong_space_is_found(text: str, wrong: list[str]) -> None:
    assert find_wrong_spaces(text, dict.fromkeys(";!?:", " ")) == wrong


@pytest.mark.parametrize(
    ("wanted", "made", "chosen"),
    [
        ("fr-CA", ("en", "fr-CA"), "fr-CA"),
        ("fr-CA", ("en", "fr"), "fr"),
        ("fr", ("en", "fr-CA"), "fr-CA"),
        ("fr", ("en",), "en"),
        ("en", ("fr", "en"), "en"),
    ],
)
def test_a_language_that_was_not_made_is_served_by_the_nearest(
    wanted: Language, made: tuple[Language, ...], chosen: Language
) -> None:
    assert find_nearest(wanted, made) == chosen


@pytest.mark.parametrize(
    ("language", "number", "form"),
    [
        ("en", "0", "times"),
        ("en", "1", "time"),
        ("en", "1\u202f000", "times"),
        ("fr", "0", "time"),
        ("fr", "1,5", "time"),
        ("fr", "2", "times"),
    ],
)
def test_a_noun_follows_its_number(language: Language, number: str, form: str) -> None:
    text = apply_typography("{n} {n|time|times}", language)

    assert fill(text, {"n": number}) == f"{number}\u00a0{form}"


# Numbers, durations and times as the two languages write them.


N = "\u202f"
MORNING = datetime(2026, 3, 3, 10, 42, 5, tzinfo=UTC)
TORONTO = datetime(2027, 3, 14, 1, 30, tzinfo=ZoneInfo("America/Toronto"))  # half an hour before summer time
NIGHT = datetime(2026, 3, 2, 22, tzinfo=UTC)

WRITTEN = {
    "a percentage always has one decimal": (
        [format_percent(x, "en") for x in (0, 7.55, 100)],
        [f"0.0{N}%", f"7.5{N}%", f"100.0{N}%"],
    ),
    "French has a decimal comma": (format_percent(7.6, "fr"), "7,6\u00a0%"),
    "thousands are grouped with a narrow space": (format_number(28740.5, 1, "fr"), f"28{N}740,5"),
    "a small negative number is not minus zero": (format_number(-0.04, 1, "en"), "0.0"),
    "a negative number has a true minus": (format_number(-3.2, 1, "en"), "−3.2"),
    "a missing number is a dash": (
        [format_number(value, 1, "en") for value in (None, float("nan"), float("inf"))],
        ["–"] * 3,
    ),
    "degrees are whole": (format_angle(54.4, "fr"), "54°"),
    "exact seconds have no trailing zeros": (format_exact(24492.3456, "en"), f"24{N}492.3456"),
    "the time account is exact to the second": (
        format_long_duration(24492.4),
        f"6{N}h\u00a048{N}min\u00a012{N}s",
    ),
    "clock times": ([format_clock(MORNING, "en"), format_clock(MORNING, "fr")], ["10:42", f"10{N}h{N}42"]),
    "a whole hour is short on a French axis": (
        format_hour(datetime(2026, 3, 3, 8, tzinfo=UTC), "fr"),
        f"8{N}h",
    ),
    "dates are unambiguous": (
        [format_date(date(2026, 3, 3), "en"), format_date(date(2026, 8, 1), "fr")],
        ["3\u00a0March\u00a02026", "1er\u00a0août\u00a02026"],
    ),
    "rates are whole from ten on": ([format_rate(x, "en") for x in (31.7, 8.61)], ["32", "8.6"]),
    "elapsed time": (format_elapsed(3725), "1:02:05"),
    "without a clock, time counts from the first sample": (Clock(None, "fr").format(3725), "1:02:05"),
    "a zone with daylight saving is followed": (Clock(TORONTO, "en").format(3600), "03:30"),
    "a device clock counts on": (Clock(TORONTO.replace(tzinfo=None), "en").format(3600), "02:30"),
    "over midnight each time has its date": (
        [plain(Clock(NIGHT, language, 8 * 3600.0).format(7200)) for language in ("en", "fr")],
        ["00:00 on 3 March", "0 h 00 le 3 mars"],
    ),
    "a recording within one date has no date in its times": (
        Clock(NIGHT, "en", 3600.0).format(3600),
        "23:00",
    ),
    "a range within one day has one date": (
        plain(Clock(NIGHT, "en", 8 * 3600.0).format_range(1800, 2700)),
        "22:30–22:45 on 2 March",
    ),
    "a range over midnight has both dates": (
        plain(Clock(NIGHT, "en", 8 * 3600.0).format_range(7080, 7320)),
        "23:58 on 2 March – 00:02 on 3 March",
    ),
    "a whole hour on a French axis has its date": (
        plain(Clock(NIGHT, "fr", 8 * 3600.0).format_range(10800, 14400, is_hour=True)),
        "1 h–2 h le 3 mars",
    ),
    "the axis begins with the first whole hour": (
        Clock(datetime(2026, 3, 3, 7, 58, 12, tzinfo=UTC)).seconds_to_whole_hour(),
        108.0,
    ),
}


@pytest.mark.parametrize("fact", WRITTEN)
def test_numbers_and_times_are_written_as_the_language_asks(fact: str) -> None:
    written, expected = WRITTEN[fact]

    assert written == expected


@pytest.mark.parametrize(
    ("seconds", "told"),
    [
        (0, f"0{N}s"),
        (4.24, f"4.2{N}s"),
        (9.96, f"10{N}s"),
        (179, f"2{N}min\u00a059{N}s"),
        (120, f"2{N}min"),
        (599.6, f"10{N}min"),
        (24480, f"6{N}h\u00a048{N}min"),
        (3599, f"1{N}h"),
        (None, "–"),
    ],
)
def test_durations_have_the_two_units_that_matter(seconds: float | None, told: str) -> None:
    assert format_duration(seconds, "en") == told


@pytest.mark.parametrize(
    ("low_s", "high_s", "told"),
    [
        (40.2, 65.1, "40 s–1 min 5 s"),
        (21.3, 21.5, "21 s–22 s"),
        (65.1, 65.3, "1 min 5 s–1 min 6 s"),
        (4.22, 4.24, "4.2 s–4.3 s"),
    ],
)
def test_a_narrow_range_of_lengths_includes_its_figure(low_s: float, high_s: float, told: str) -> None:
    assert " ".join(format_duration_range(Interval(low_s, high_s), "en").split()) == told
