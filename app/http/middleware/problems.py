"""Refused requests as ``application/problem+json`` (RFC 9457) in the requested language."""

import json
import logging
import re
import secrets
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any, TypeVar, cast
from urllib.parse import parse_qsl, unquote, urlencode

from fastapi import FastAPI, Request
from fastapi.exceptions import RequestValidationError
from fastapi.responses import JSONResponse
from pydantic import BaseModel, ValidationError
from starlette.exceptions import HTTPException
from starlette.requests import ClientDisconnect

from acromion.app.accounts.accounts import TOKEN_PREFIX
from acromion.app.errors import (
    AppError,
    BadParameter,
    BrokenUpload,
    InternalError,
    NoSuchRange,
    NotHere,
    RecordedProblem,
    WrongVerb,
    find_outcome_of_code,
)
from acromion.app.http.middleware.guard import check_json
from acromion.app.report.words.messages import describe_flag, describe_problem
from acromion.app.report.words.wording import Language
from acromion.app.services import choose_language
from acromion.fusion.errors import Fact, FusionError
from acromion.fusion.recording import QualityFlag

# Validation hints: the values that a field accepts, read from the published schema.


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


def format_model_hint(model: type[BaseModel], place: Place) -> str:
    """Format the hint of a field in a model (``("items", 0, "side")``); "" for an unknown field."""
    schema = model.model_json_schema()
    return _format_hint(_walk(schema, place, schema), schema)


def format_route_hint(request: Request, place: Place) -> str:
    """Format the hint of a request field (``("query", "rate_hz")``) from its OpenAPI operation."""
    document = cast("FastAPI", request.app).openapi()
    path = getattr(request.scope.get("route"), "path_format", "")
    operation = document["paths"].get(path, {}).get(request.method.lower(), {})
    where, *rest = place
    if where == "body":
        content = operation.get("requestBody", {}).get("content", {})
        schema = content.get("application/json", {}).get("schema", {})
        return _format_hint(_walk(schema, rest, document), document)
    known = {p["name"]: p["schema"] for p in operation.get("parameters", ()) if p["in"] == where}
    return _format_hint(_walk({"properties": known}, rest, document), document)


def _walk(schema: Schema, place: Place, document: Schema) -> Schema:
    """Return the schema of a field; for an unknown name, the schema of its parent."""
    for part in place:
        schema = _resolve(schema, document)
        inner = schema.get("items") if isinstance(part, int) else schema.get("properties", {}).get(part)
        if inner is None:
            break
        schema = inner
    return _resolve(schema, document)


def _resolve(schema: Schema, document: Schema) -> Schema:
    """Resolve references; of several types, return the first that is not null."""
    if "anyOf" in schema:
        schema = next(kind for kind in schema["anyOf"] if kind.get("type") != "null")
        return _resolve(schema, document)
    if "$ref" not in schema:
        return schema
    found: Any = document
    for name in schema["$ref"].removeprefix("#/").split("/"):
        found = found[name]
    return _resolve(found, document)


def _format_hint(schema: Schema, document: Schema) -> str:
    """Format the hint in symbols, which need no translation."""
    if "enum" in schema or "const" in schema:
        return ", ".join(map(str, schema.get("enum", [schema.get("const")])))
    if schema.get("properties"):
        return ", ".join(schema["properties"])
    low, high = schema.get("minimum"), schema.get("maximum")
    if schema.get("type") in ("number", "integer") and low is not None:
        return f"{low:g} … {high:g}" if high is not None else f"≥ {low:g}"
    if schema.get("type") in ("number", "integer") and high is not None:
        return f"≤ {high:g}"
    if schema.get("type") == "array" and "items" in schema:
        return f"[{_format_hint(_resolve(schema['items'], document), document)}]"
    return _SIGNS.get(schema.get("type", ""), "")


TUS_HEADERS: Mapping[str, str] = {"Tus-Resumable": "1.0.0", "Tus-Version": "1.0.0"}

logger = logging.getLogger(__name__)


class ProblemView(BaseModel):
    """Why a request was refused. ``code`` never changes; the texts are in the requested language."""

    type: str
    title: str
    status: int
    detail: str
    code: str
    fix: str
    where: dict[str, Fact] | None
    retryable: bool
    instance: str | None = None


PROBLEM_RESPONSES: dict[int | str, dict[str, Any]] = {
    "4XX": {
        "description": "Refused; the response states the reason and what to do.",
        "content": {"application/problem+json": {"schema": {"$ref": "#/components/schemas/ProblemView"}}},
    }
}


def view_problem(code: str, facts: Mapping[str, Fact], language: Language, instance: str) -> ProblemView:
    """Build the view of a refusal."""
    words, outcome = describe_problem(code, facts, language), find_outcome_of_code(code)
    place = {name: facts[name] for name in ("line", "byte", "clock") if name in facts}
    return ProblemView(
        type=f"/api/v1/problems/{code}",
        title=words.title,
        status=outcome.status,
        detail=words.detail,
        code=code,
        fix=words.fix,
        where=place or None,
        retryable=outcome.retryable,
        instance=instance,
    )


def view_flag(code: str, language: Language, instance: str) -> ProblemView:
    """Build the view of a warning. Its status is 200 because a warning refuses nothing, and it has no fix."""
    caveat, place = describe_flag(QualityFlag(code), language), f"/api/v1/problems/{code}"
    about = {"title": caveat.title, "detail": caveat.detail, "code": code, "fix": ""}
    return ProblemView(type=place, status=200, where=None, retryable=False, instance=instance, **about)


Model = TypeVar("Model", bound=BaseModel)
Refusal = FusionError | AppError | RecordedProblem


def respond_to_refusal(request: Request, error: Refusal) -> JSONResponse:
    """Return the problem response with its status."""
    language = choose_language(request)
    view = view_problem(error.code, error.facts, language, request.url.path)
    headers = {"Content-Language": language, "Vary": "Accept-Language"}
    if request.method not in ("GET", "HEAD"):
        headers["Connection"] = "close"  # the body may be unread
    if isinstance(error, NoSuchRange):
        headers["Content-Range"] = f"bytes */{error.facts['size']}"
    if view.retryable and view.status in (409, 423, 429, 503, 507):
        headers["Retry-After"] = "5"
    if request.url.path.startswith("/api/v1/uploads"):
        headers |= TUS_HEADERS
    return JSONResponse(
        view.model_dump(), view.status, headers=headers, media_type="application/problem+json"
    )


def translate_error(request: Request, error: Exception) -> Refusal:
    """Convert an error of the framework, or a bug, into one of the project's errors."""
    if isinstance(error, Refusal):
        return error
    if isinstance(error, ClientDisconnect):
        return BrokenUpload()
    if isinstance(error, RequestValidationError):
        return _build_bad_parameter(error.errors()[0], partial(format_route_hint, request))
    if isinstance(error, HTTPException) and error.status_code == 405:
        return WrongVerb()
    if isinstance(error, HTTPException) and error.status_code == 400:  # raised while reading a body
        cause = error.__cause__
        return cause if isinstance(cause, Refusal) else BadParameter(name="body", value="", allowed="JSON")
    if isinstance(error, HTTPException) and error.status_code == 404:
        return NotHere()
    reference = secrets.token_hex(4)
    logger.error("bug, reference %s", reference, exc_info=error)
    return InternalError(reference=reference)


def validate_model(model: type[Model], values: object) -> Model:
    """Validate values against a model outside of a route's signature. Raises BadParameter."""
    try:
        return model.model_validate(values)
    except ValidationError as error:
        raise _build_bad_parameter(error.errors()[0], partial(format_model_hint, model)) from None


def parse_json(body: bytes) -> Any:
    """Parse a JSON body. Raises BadParameter."""
    check_json(body)
    try:
        return json.loads(body)
    except (ValueError, RecursionError):
        raise BadParameter(name="body", value="", allowed="JSON") from None


def _build_bad_parameter(error: Mapping[str, Any], find_hint: Callable[[Place], str]) -> BadParameter:
    name = next((str(part) for part in reversed(error["loc"]) if isinstance(part, str)), "body")
    known = _format_context_hint(error) or find_hint(error["loc"])
    return BadParameter(name=hide_tokens(name)[:60], value=show_input(error), allowed=known)


def _format_context_hint(error: Mapping[str, Any]) -> str:
    """Format the hint that pydantic's error contains, in symbols."""
    if error["type"] == "json_invalid":
        return "JSON"
    limits = error.get("ctx") or {}
    if "expected" in limits:
        return str(limits["expected"]).replace("'", "").replace(" or ", ", ")
    lengths = {"max_length": "≤", "min_length": "≥"}
    return ", ".join(f"{sign} {limits[name]}" for name, sign in lengths.items() if name in limits)


# Secrets: a response never repeats a password, a token, a code or another secret of the request.

MAX_SHOWN_LENGTH = 60
HIDDEN = "…"
_SECRET = re.compile(r"passw|pwd|secret|token|(code|key|proof|ticket)s?(?![a-z])")
_TOKEN = re.compile(rf"{TOKEN_PREFIX}[\w-]{{43}}")


def contains_token(text: str) -> bool:
    """Return whether a part of an address contains a token, also percent-encoded."""
    return _TOKEN.search(unquote(text)) is not None


def is_secret(name: object) -> bool:
    """Return whether a field of this name may contain a secret."""
    return isinstance(name, str) and _SECRET.search(name.lower()) is not None


def show_input(error: Mapping[str, Any]) -> str:
    """Return the value of a refused field in the form that a response may repeat; ``error`` is pydantic's.

    A whole body or an object is hidden, because another of its fields may be a secret.
    """
    place, given = error["loc"], error.get("input")
    is_whole = error["type"] == "missing" or place in ((), ("body",))
    if is_whole or any(map(is_secret, place)) or isinstance(given, dict | list | tuple | bytes):
        return HIDDEN
    return hide_tokens(str(given))[:MAX_SHOWN_LENGTH]


def hide_tokens(text: str) -> str:
    """Return a text with its tokens replaced by "…"."""
    return _TOKEN.sub(HIDDEN, text)


def drop_secrets(query: str) -> str:
    """Return a query without the fields that may contain a secret."""
    pairs = parse_qsl(query, keep_blank_values=True)
    kept = [pair for pair in pairs if not is_secret(pair[0]) and not any(map(contains_token, pair))]
    return query if len(kept) == len(pairs) else urlencode(kept)


def hide_address(request: Request) -> Request:
    """Return a request without tokens in its address; the same request if there are none."""
    scope = request.scope
    path, query = str(scope["path"]), scope["query_string"].decode("latin-1")
    if not contains_token(f"{path}?{query}"):
        return request
    hidden = hide_tokens(unquote(path))
    return Request({**scope, "path": hidden, "query_string": drop_secrets(query).encode("latin-1")})
