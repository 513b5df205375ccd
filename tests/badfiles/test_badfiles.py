"""Every bad file, A to E, through `fusion`, the command line and the API."""

import json
from collections.abc import Iterator
from pathlib import Path

import pytest
from fastapi.testclient import TestClient
from typer.testing import CliRunner

from acromion.app.cli import app
from acromion.app.main import create_app
from acromion.app.report.words.messages import describe_problem
from acromion.app.report.words.wording import LANGUAGES, Language
from acromion.app.settings import Settings
from acromion.fusion.caveats import Caveat
from acromion.fusion.errors import FusionError
from acromion.fusion.pipeline import Analysis
from tests.badfiles.expected import ALWAYS, BAD_FILES
from tests.badfiles.outcomes import BadFile
from tests.badfiles.ways_in import Server, analyse_by_fusion, codes_in, content_of

REFUSED = [bad for bad in BAD_FILES if bad.code]
ONE_OF_EACH = list({bad.code: bad for bad in REFUSED}.values())
READ = [bad for bad in BAD_FILES if not bad.code]
SENT = READ[:: len(READ) // 3]
"""A few of those that give a report go all the way through the server: one road serves them all."""


def name_row(bad: BadFile) -> str:
    return f"row {bad.row}"


def test_no_row_is_named_twice() -> None:
    rows = [bad.row for bad in BAD_FILES]

    assert len(set(rows)) == len(rows)


@pytest.mark.parametrize("bad", REFUSED, ids=name_row)
def test_it_is_refused_with_its_code(bad: BadFile) -> None:
    with pytest.raises(FusionError) as refusal:
        analyse_by_fusion(bad)

    assert refusal.value.code == bad.code
    assert bad.facts <= {f"{name}={value}" for name, value in refusal.value.facts.items()}


@pytest.mark.parametrize("bad", READ, ids=name_row)
def test_it_is_read_with_its_warnings_and_times(bad: BadFile) -> None:
    analysis = analyse_by_fusion(bad)

    time = analysis.time
    seen_s = [us / 1e6 for us in (time.analysed_us, time.missing_us, time.excluded_us)]
    assert {flag.code for flag in analysis.quality.flags} - ALWAYS == bad.warnings
    assert bad.facts <= set(list_facts(analysis))
    assert seen_s == pytest.approx([bad.analysed_s, bad.missing_s, bad.excluded_s], abs=0.006)
    assert time.analysed_us + time.missing_us + time.excluded_us == time.recorded_us
    assert all(flag.facts.keys() <= Caveat(flag.code).fact_meanings.keys() for flag in analysis.quality.flags)


def list_facts(analysis: Analysis) -> Iterator[str]:
    """Each caveat's own facts, its count and its place, as the rows write them."""
    for flag in analysis.quality.flags:
        for name, value in {"count": flag.count, "first_s": flag.first_s, **flag.facts}.items():
            yield f"{flag.code} {name}={value}"


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Server]:
    """A server of this module's own."""
    settings = Settings(data_dir=tmp_path_factory.mktemp("bad") / "data", min_free_bytes=0)
    with TestClient(create_app(settings), base_url="http://localhost:8080") as client:
        yield Server(client, settings)


@pytest.mark.parametrize("language", ["en", "fr"])
def test_the_command_line_names_a_refusal_of_each_code(language: Language, tmp_path: Path) -> None:
    paths = [tmp_path / f"{number:03d}" / bad.name for number, bad in enumerate(ONE_OF_EACH)]
    for path, bad in zip(paths, ONE_OF_EACH, strict=True):
        path.parent.mkdir()
        path.write_bytes(content_of(bad))

    ended = CliRunner().invoke(
        app, ["run", *map(str, paths), "-o", str(tmp_path / "out"), "--lang", language, "-j", "1"]
    )

    told = [line.split(": ", 1)[1] for line in ended.stderr.splitlines() if line.startswith("[")]
    assert ended.exit_code == 3
    assert told == [f"{bad.code} {title_of(bad, language)}" for bad in ONE_OF_EACH]


def title_of(bad: BadFile, language: Language) -> str:
    return describe_problem(bad.code or "", {}, language).title


def test_the_command_line_gives_the_other_files_their_warnings(tmp_path: Path) -> None:
    paths = []
    for number, bad in enumerate(SENT):
        paths.append(tmp_path / f"{number:03d}-{bad.name}")
        paths[-1].write_bytes(content_of(bad))

    ended = CliRunner().invoke(
        app, ["run", *map(str, paths), "-o", str(tmp_path / "out"), "--report", "html"]
    )

    results = sorted((tmp_path / "out").glob("*/results.json"))
    assert ended.exit_code == 0
    assert [codes_in(json.loads(path.read_text())) for path in results] == [bad.warnings for bad in SENT]


@pytest.mark.parametrize("language", LANGUAGES)
def test_the_api_names_a_refusal(server: Server, language: Language) -> None:
    bad = next(one for one in ONE_OF_EACH if one.code == "E-COLS")

    problem = server.build_problem_row(server.send(bad), language)

    assert (problem["title"], problem["code"]) == (title_of(bad, language), bad.code)
    assert problem["detail"]
    assert problem["fix"]


def test_the_api_gives_the_same_warnings(server: Server) -> None:
    address = server.send(SENT[0])

    assert codes_in(server.client.get(f"{address}/results.json").json()) == SENT[0].warnings
