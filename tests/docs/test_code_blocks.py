"""Every block of code in the documents: it is whole, its names exist, its commands and options are ours."""

import ast
import contextlib
import importlib
import importlib.util
import json
import re
import shlex
import tomllib
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import click
import pytest
import typer.main
import yaml

from acromion.app.cli import app
from acromion.app.main import create_app
from acromion.app.settings import Settings
from tests import ROOT

PAGES = sorted(
    path
    for path in (*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md"))
    if path.name not in ("CHANGELOG.md", "guide.md")
)
FENCE = re.compile(r"^```([\w+-]*)[^\n]*\n(.*?)^```$", re.DOTALL | re.MULTILINE)
KNOWN = {"sh", "python", "r", "csv", "toml", "json", "yaml", "text", "http", "ini", "cpp", "javascript"} | {
    *("diff", "groovy", "snakemake"),  # patches that a test lays over a copy; what other programs read
}
PARSERS: Mapping[str, Callable[[str], object]] = {
    "toml": tomllib.loads,
    "json": json.loads,
    "yaml": yaml.safe_load,
    "python": ast.parse,
}

Block = tuple[str, str, str]


def list_blocks(*languages: str) -> Iterator[Block]:
    for path in PAGES:
        for language, body in FENCE.findall(path.read_text("utf-8")):
            if not languages or language in languages:
                yield path.relative_to(ROOT).as_posix(), language, body


def name_block(block: Block) -> str:
    return f"{block[0]}: {block[2].strip().splitlines()[0][:40]}"


def test_every_block_says_its_language() -> None:
    assert [name_block(block) for block in list_blocks() if block[1] not in KNOWN] == []


@pytest.mark.parametrize("block", list(list_blocks(*PARSERS)), ids=name_block)
def test_a_block_is_whole(block: Block) -> None:
    PARSERS[block[1]](block[2])


@pytest.mark.parametrize("block", list(list_blocks("python")), ids=name_block)
def test_every_name_that_a_block_imports_exists(block: Block) -> None:
    for node in ast.walk(ast.parse(block[2])):
        if isinstance(node, ast.ImportFrom):
            module = importlib.import_module(str(node.module))
            assert [name.name for name in node.names if not hasattr(module, name.name)] == []
        elif isinstance(node, ast.Import):
            assert [name.name for name in node.names if importlib.util.find_spec(name.name) is None] == []


def split_commands(body: str) -> Iterator[list[str]]:
    """Return the words of each command: lines that end in a backslash go on, && and | end one."""
    for line in body.replace("\\\n", " ").splitlines():
        for words in _split_line(line):
            if words:
                yield words


def _split_line(line: str) -> Iterator[list[str]]:
    lexer = shlex.shlex(line, posix=True, punctuation_chars="&|;<>")
    lexer.whitespace_split = True
    words: list[str] = []
    for word in lexer:
        if set(word) <= set("&|;"):
            yield words
            words = []
        else:
            words.append(word)
    yield words


def list_ours() -> Iterator[tuple[str, list[str]]]:
    for page, _, body in list_blocks("sh"):
        for words in split_commands(body):
            if Path(words[0]).name == "acromion":
                yield page, words[1:]


def parse(words: list[str]) -> None:
    """Parse as the command line does, without the checks of files; an unknown word raises."""
    group = typer.main.get_command(app)
    assert isinstance(group, click.Group | typer.core.TyperGroup)
    if words[0] == "--help":
        return
    command = group.commands[words[0]]
    context = command.context_class(command, info_name=words[0])
    command.make_parser(context).parse_args(args=[word for word in words[1:] if word not in ("<", ">")])


@pytest.mark.parametrize(
    ("page", "words"),
    list(list_ours()),
    ids=[f"{page}: {' '.join(words)[:50]}" for page, words in list_ours()],
)
def test_every_command_of_ours_has_the_options_that_a_page_gives_it(page: str, words: list[str]) -> None:
    parse(words)


def test_an_option_that_does_not_exist_is_seen() -> None:
    with pytest.raises(Exception, match=r"(?i)no such option"):
        parse(["run", "shift.gt3x", "--no-such-option"])


def test_every_module_that_a_page_runs_exists() -> None:
    named = {
        (path.name, module)
        for path in PAGES
        for module in re.findall(r"python3? -m ([a-z][\w.]+)", path.read_text("utf-8"))
    }

    assert len(named) > 5
    assert [(page, name) for page, name in named if importlib.util.find_spec(name) is None] == []


def test_every_address_that_a_command_asks_exists(tmp_path: Path) -> None:
    known = [
        re.sub(r"\{[^}]+\}", "[^/]+", path)
        for path in create_app(Settings(data_dir=tmp_path)).openapi()["paths"]
    ]
    asked = {
        (page, path)
        for page, _, body in list_blocks("sh", "python", "r")
        for path in re.findall(r"(/api/v1/[\w/.-]+)", re.sub(r"\$\w+", "ID", body))
    }

    assert asked
    assert [one for one in sorted(asked) if not any(re.fullmatch(pattern, one[1]) for pattern in known)] == []


def run_page(page: str, folder: Path) -> dict[str, Any]:
    """Run the blocks of a page from top to bottom in a folder, as one script; return its variables."""
    names: dict[str, Any] = {"__name__": "__main__"}
    with contextlib.chdir(folder):
        for _, _, body in (block for block in list_blocks("python") if block[0] == page):
            exec(body, names)
    return names


PYTHON_PAGE = "docs/code/python.md"


@pytest.fixture(scope="module")
def python_page(shift_gt3x: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """Run the page from top to bottom beside a recording; give its variables."""
    folder = tmp_path_factory.mktemp("python_page")
    (folder / "shift.gt3x").write_bytes(shift_gt3x.read_bytes())
    return run_page(PYTHON_PAGE, folder)


def test_the_page_for_python_gives_the_angle_in_pandas(python_page: dict[str, Any]) -> None:
    assert list(python_page["angles"].columns) == ["time_s", "elevation_deg", "valid"]


def test_a_sensor_at_rest_has_its_vertical_along_z(python_page: dict[str, Any]) -> None:
    assert python_page["up"][-1].round(3).tolist() == [0, 0, 1]


def test_a_folder_of_one_recording_gives_one_share(python_page: dict[str, Any]) -> None:
    assert python_page["shares"].keys() == {"shift"}
