"""What would have been right in the place of a value that was refused, from the schema that is published."""

from collections.abc import Mapping, Sequence
from typing import Any, cast

from fastapi import FastAPI, Request
from pydantic import BaseModel

Schema = Mapping[str, Any]
Place = Sequence[str | int]

_SIGNS = {
    "boolean": "true, false",
    "integer": "0, 1, 2 …",
    "number": "0.5, 1, 2 …",
    "string": '"…"',
    "array": "[…]",
    "object": "{…}",
}


def say_allowed_of(model: type[BaseModel], place: Place) -> str:
    """Say what a model takes at a place (``("items", 0, "side")``); "" for a place it does not have."""
    schema = model.model_json_schema()
    return _say(_walk(schema, place, schema), schema)


def say_allowed_to(request: Request, place: Place) -> str:
    """Say what a route takes at a place (``("query", "rate_hz")``), by its own OpenAPI operation."""
    document = cast("FastAPI", request.app).openapi()
    path = getattr(request.scope.get("route"), "path_format", "")
    operation = document["paths"].get(path, {}).get(request.method.lower(), {})
    where, *rest = place
    if where == "body":
        content = operation.get("requestBody", {}).get("content", {})
        schema = content.get("application/json", {}).get("schema", {})
        return _say(_walk(schema, rest, document), document)
    known = {p["name"]: p["schema"] for p in operation.get("parameters", ()) if p["in"] == where}
    return _say(_walk({"properties": known}, rest, document), document)


def _walk(schema: Schema, place: Place, document: Schema) -> Schema:
    """Go down to the place; to what holds it, where it is a name that is not known there."""
    for part in place:
        schema = _resolve(schema, document)
        inner = schema.get("items") if isinstance(part, int) else schema.get("properties", {}).get(part)
        if inner is None:
            break
        schema = inner
    return _resolve(schema, document)


def _resolve(schema: Schema, document: Schema) -> Schema:
    """Follow a reference, and of several kinds take the first that is not null."""
    if "anyOf" in schema:
        schema = next(kind for kind in schema["anyOf"] if kind.get("type") != "null")
        return _resolve(schema, document)
    if "$ref" not in schema:
        return schema
    found: Any = document
    for name in schema["$ref"].removeprefix("#/").split("/"):
        found = found[name]
    return _resolve(found, document)


def _say(schema: Schema, document: Schema) -> str:
    """Put it in signs, which need no language."""
    if "enum" in schema or "const" in schema:
        return ", ".join(map(str, schema.get("enum", [schema.get("const")])))
    if schema.get("properties"):
        return ", ".join(schema["properties"])
    if schema.get("type") in ("number", "integer"):
        return _say_range(schema) or _SIGNS[schema["type"]]
    if schema.get("type") == "array" and "items" in schema:
        return f"[{_say(_resolve(schema['items'], document), document)}]"
    return _SIGNS.get(schema.get("type", ""), "")


def _say_range(schema: Schema) -> str:
    low, high = schema.get("minimum"), schema.get("maximum")
    if low is not None and high is not None:
        return f"{low:g} … {high:g}"
    return f"≥ {low:g}" if low is not None else f"≤ {high:g}" if high is not None else ""
