"""Write the pages of docs/reference and docs/guide from the code.

python -m benchmarks.reference
"""

import csv
import json
import re
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import typer.core
import typer.main

from acromion.app.cli import app
from acromion.app.main import create_app
from acromion.app.report.export.tables import write_document as write_dictionary
from acromion.app.settings import Settings
from benchmarks.codes import write_document as write_codes
from benchmarks.devices import draw_devices
from benchmarks.public_files import COLUMNS, FOUND
from benchmarks.settings import write_document as write_settings
from benchmarks.site.guide import build_guide

DOCS = Path(__file__).resolve().parents[1] / "docs"
MADE = "Made from the code: `python -m benchmarks.reference`"
"""The first line of a page that this module writes."""

CLI = """{made}

# Command line

Every command with its arguments and options. `acromion COMMAND --help` prints the same.
[Many recordings](../batch.md) shows how to use `acromion run`.
{commands}"""

API = """{made}

# REST API: every operation

All addresses begin with `/api/v1`. [The REST API](../api.md) has worked examples and describes sign-in,
errors and limits. A server shows the same description at `/api/v1/docs` and returns it from
`/api/v1/openapi.json`. Every operation can also answer 4XX: a [problem](#problemview) with a
[code](codes.md), as `application/problem+json`.
{operations}
## Schemas { #schemas }
{schemas}"""

FORMATS = """{made}

# Devices and files that were tried

[Formats](../formats.md) describes what is read and what is checked.

## Known devices

The table comes from `fusion/devices.py`. A header line, or a line above it, identifies the device. "Unstated
units" are the units that the device's columns leave out; the reader takes them from this table.

{devices}

## Public files that were tried

{files} recordings from {repositories} public repositories and {folders} shared folders. "Asked" means that
the file leaves something out and was read with a person's answer. `python -m benchmarks.public_files FOLDER`
reads the files again and writes `benchmarks/public_files.csv`, the source of this table. The recordings
themselves are not in the repository.

{table}
"""


def main() -> None:
    """Write every page."""
    for name, text in build_pages().items():
        path = DOCS / name
        path.parent.mkdir(exist_ok=True)
        path.write_text(text, "utf-8")


def build_pages() -> dict[str, str]:
    """Return the text of each page and drawing by its path in ``docs``."""
    return {
        "reference/api.md": write_api(),
        "reference/cli.md": write_cli(),
        "reference/codes.md": write_codes(),
        "reference/dictionary.md": write_dictionary(),
        "reference/formats.md": write_formats(),
        "reference/settings.md": write_settings(),
    } | {
        f"guide/{name}": f"{MADE}\n\n{text}" if name.endswith(".md") else text
        for name, text in build_guide().items()
    }


def write_cli() -> str:
    """Return the page of every command and option."""
    root = typer.main.get_command(app)
    return CLI.format(made=MADE, commands="".join(_describe_commands(root, "acromion")))


def _describe_commands(group: Any, name: str) -> Iterator[str]:
    for word, command in group.commands.items():
        if command.hidden:
            continue
        full = f"{name} {word}"
        if isinstance(command, typer.core.TyperGroup):
            yield from _describe_commands(command, full)
        else:
            yield from _describe_command(command, full)


def _describe_command(command: typer.core.TyperCommand, name: str) -> Iterator[str]:
    context = command.context_class(command, info_name=name)
    pieces = " ".join(command.collect_usage_pieces(context))
    yield f"\n## {name}\n\n{_clean(command.help or '')}\n\n```text\n{name} {pieces}\n```\n"
    shown = [one for one in command.params if not getattr(one, "hidden", False)]
    rows = [_describe_parameter(one, context) for one in shown]
    if rows:
        yield "\n" + draw_table(("name", "value", "default", "meaning"), rows)


def _describe_parameter(parameter: Any, context: Any) -> list[str]:
    meaning, _, stated = (parameter.help or "").replace("\\[", "[").partition(" [default: ")
    if parameter.param_type_name == "argument":
        name, value = f"`{parameter.display_name_raw}`", ""
    else:
        name = ", ".join(f"`{one}`" for one in (*parameter.opts, *parameter.secondary_opts))
        value = "" if parameter.is_flag else parameter.metavar or parameter.display_type(context)
    values = " or ".join(f"`{one}`" for one in value.strip("<>").split("|") if one)
    is_set = parameter.default not in (None, False, "", []) and not callable(parameter.default)
    shown = getattr(parameter, "show_default", None)  # of an option that may also be in the environment
    default = (
        str(parameter.default) if is_set else stated.rstrip("]") or (shown if isinstance(shown, str) else "")
    )
    return [name, values, "required" if parameter.required else _clean_cell(default), _clean_cell(meaning)]


def write_api() -> str:
    """Return the page of every REST operation and schema."""
    with tempfile.TemporaryDirectory() as folder:
        document = create_app(Settings(data_dir=Path(folder))).openapi()
    schemas = document["components"]["schemas"]
    operations = "".join(_describe_operations(document["paths"]))
    described = "".join(_describe_schema(*pair) for pair in sorted(schemas.items()))
    page = API.replace("{made}", MADE).replace("{operations}", operations)
    return page.replace("{schemas}", described)


def _describe_operations(paths: Mapping[str, Any]) -> Iterator[str]:
    operations = [
        (_find_group(path), method.upper(), path.removeprefix("/api/v1"), one)
        for path, methods in paths.items()
        for method, one in methods.items()
    ]
    for group in dict.fromkeys(operation[0] for operation in operations):
        yield f"\n## {group}\n"
        for of, method, path, one in operations:
            if of == group:
                yield f"\n### {method} {_escape(path)}\n\n{_clean(one.get('description', ''))}\n"
                yield from _describe_call(one)


def _find_group(path: str) -> str:
    return path.removeprefix("/api/v1/").partition("/")[0].capitalize()


def _describe_call(operation: Mapping[str, Any]) -> Iterator[str]:
    rows = [
        [
            f"`{one['name']}`",
            one["in"] + (", required" if one.get("required") else ""),
            _describe_type(one["schema"]),
            _clean_cell(one.get("description", "")),
        ]
        for one in operation.get("parameters", ())
    ]
    if rows:
        yield "\n" + draw_table(("parameter", "in", "type", "meaning"), rows)
    body = operation.get("requestBody", {}).get("content", {})
    if body:
        yield f"\nBody: {_describe_content(body)}.\n"
    answers = []
    for status, one in operation.get("responses", {}).items():
        if status != "4XX":
            content = _describe_content(one.get("content", {}))
            told = f"{status} {_clean_cell(one.get('description', ''))}".strip()
            answers.append(f"{told} ({content})" if content else told)
    yield "\nResponses: " + "; ".join(answers) + ".\n"


def _describe_content(content: Mapping[str, Any]) -> str:
    kinds = [
        f"`{kind}` {_describe_type(one['schema'])}" if one.get("schema") else f"`{kind}`"
        for kind, one in content.items()
    ]
    return ", ".join(kinds)


def _describe_schema(name: str, schema: Mapping[str, Any]) -> str:
    required = schema.get("required", ())
    rows = [
        [
            f"`{field}`",
            _describe_type(one) + (", required" if field in required else ""),
            _clean_cell(one.get("description", "")),
        ]
        for field, one in schema.get("properties", {}).items()
    ]
    text = _clean(schema.get("description", ""))
    parts = [f"\n### {name}\n", f"{text}\n" if text else ""]
    parts.append(draw_table(("field", "type", "meaning"), rows) if rows else "")
    return "\n".join(part for part in parts if part)


def _describe_type(schema: Mapping[str, Any]) -> str:
    """Return a type in words: ``integer 1 to 100``, ``a or b``, a link to a schema."""
    if "$ref" in schema:
        name = schema["$ref"].rpartition("/")[2]
        return f"[{name}](#{name.lower()})"
    if "anyOf" in schema or "oneOf" in schema:
        return " or ".join(_describe_type(one) for one in schema.get("anyOf") or schema["oneOf"])
    if "enum" in schema:
        return " or ".join(f"`{json.dumps(one).strip(chr(34))}`" for one in schema["enum"])
    if "const" in schema:
        return f"`{schema['const']}`"
    if schema.get("type") == "array":
        return f"list of {_describe_type(schema.get('items', {}))}"
    kind = str(schema.get("type", "any value"))
    if schema.get("contentMediaType") or schema.get("format") == "binary":
        kind = "bytes"
    low, high = schema.get("minimum"), schema.get("maximum")
    return kind + (f" {low} to {high}" if None not in (low, high) else "")


def write_formats() -> str:
    """Return the page of known devices and of the public files that were tried."""
    with FOUND.open(encoding="utf-8", newline="") as file:
        rows = [[row[name] for name in COLUMNS] for row in csv.DictReader(file)]
    sources = dict.fromkeys((row[0], row[1]) for row in rows)
    shared = [source for source, licence in sources if licence == "shared"]
    cells = [[f"{source}, {licence}", *rest] for source, licence, *rest in rows]
    head = ("source, licence", "file", "read", "device", "units (acceleration, rate)", "changed")
    return FORMATS.format(
        made=MADE,
        devices=draw_devices(),
        files=len(rows),
        repositories=len(sources) - len(shared),
        folders=len(shared),
        table=draw_table(head, cells).rstrip("\n"),
    )


def draw_table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return a table in Markdown; a column without a cell is left out."""
    kept = [place for place in range(len(header)) if any(row[place] for row in rows)]
    lines = [[header[place] for place in kept], ["---"] * len(kept)]
    lines += [[row[place] for place in kept] for row in rows]
    return "".join("| " + " | ".join(line) + " |\n" for line in lines)


def _clean(text: str) -> str:
    """Turn the marks of a docstring into Markdown, and drop its line breaks within a paragraph."""
    paragraphs = re.split(r"\n\s*\n", text.replace("``", "`").strip())
    return "\n\n".join(_escape(" ".join(one.split())) for one in paragraphs)


def _clean_cell(text: str) -> str:
    return _escape(" ".join(text.replace("``", "`").split())).replace("|", "\\|")


def _escape(text: str) -> str:
    """Escape what HTML would take for a tag, outside of code."""
    parts = text.split("`")
    return "`".join(one if place % 2 else one.replace("<", "&lt;") for place, one in enumerate(parts))


if __name__ == "__main__":
    main()
