"""Refusals as ``application/problem+json`` (RFC 9457), in the language asked for."""

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

from app.accounts.accounts import TOKEN_PREFIX
from app.errors import (
    AppError,
    BadParameter,
    InternalError,
    NoSuchRange,
    NotHere,
    RecordedProblem,
    WrongVerb,
    find_outcome_of_code,
)
from app.http.middleware.guard import check_json
from app.report.words.messages import describe_flag, describe_problem
from app.report.words.wording import Language
from app.services import choose_language
from fusion.errors import Fact, FusionError
from fusion.recording import QualityFlag

# Validation hints: what a refused value may be, read from the published schema.


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
    """Write the hint of a place in a model (``("items", 0, "side")``); "" for a place it does not have."""
    schema = model.model_json_schema()
    return _format_hint(_walk(schema, place, schema), schema)


def format_route_hint(request: Request, place: Place) -> str:
    """Write the hint of a place in a request (``("query", "rate_hz")``) by its OpenAPI operation."""
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
    """Find the schema of a place; that of its parent where the place has a name that is not known."""
    for part in place:
        schema = _resolve(schema, document)
        inner = schema.get("items") if isinstance(part, int) else schema.get("properties", {}).get(part)
        if inner is None:
            break
        schema = inner
    return _resolve(schema, document)


def _resolve(schema: Schema, document: Schema) -> Schema:
    """Follow references; of several types take the first that is not null."""
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
    """Write it in symbols, which need no language."""
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
    """Why something was refused: ``code`` never changes, the sentences follow the language."""

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
        "description": "Refused; the problem says why and what to do.",
        "content": {"application/problem+json": {"schema": {"$ref": "#/components/schemas/ProblemView"}}},
    }
}


def view_problem(code: str, facts: Mapping[str, Fact], language: Language, instance: str) -> ProblemView:
    """Put a refusal into words."""
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
    """Put a warning into words. It refuses nothing: its status is 200, and there is nothing to mend."""
    caveat, place = describe_flag(QualityFlag(code), language), f"/api/v1/problems/{code}"
    about = {"title": caveat.title, "detail": caveat.detail, "code": code, "fix": ""}
    return ProblemView(type=place, status=200, where=None, retryable=False, instance=instance, **about)


Model = TypeVar("Model", bound=BaseModel)
Refusal = FusionError | AppError | RecordedProblem


def respond_to_refusal(request: Request, error: Refusal) -> JSONResponse:
    """Answer with the problem and its status."""
    language = choose_language(request)
    view = view_problem(error.code, error.facts, language, request.url.path)
    headers = {"Content-Language": language, "Vary": "Accept-Language"}
    if request.method not in ("GET", "HEAD"):
        headers["Connection"] = "close"  # there may be a body that nobody will read
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
    """Translate errors of the framework, and bugs, into one of our codes."""
    if isinstance(error, Refusal):
        return error
    if isinstance(error, RequestValidationError):
        return _build_bad_parameter(error.errors()[0], partial(format_route_hint, request))
    if isinstance(error, HTTPException) and error.status_code == 405:
        return WrongVerb()
    if isinstance(error, HTTPException) and error.status_code == 400:  # while a body was being read
        cause = error.__cause__
        return cause if isinstance(cause, Refusal) else BadParameter(name="body", value="", allowed="JSON")
    if isinstance(error, HTTPException) and error.status_code == 404:
        return NotHere()
    reference = secrets.token_hex(4)
    logger.error("bug, reference %s", reference, exc_info=error)
    return InternalError(reference=reference)


def validate_model(model: type[Model], values: object) -> Model:
    """Check values against a model outside of a route's signature. Raises BadParameter."""
    try:
        return model.model_validate(values)
    except ValidationError as error:
        raise _build_bad_parameter(error.errors()[0], partial(format_model_hint, model)) from None


def parse_json(body: bytes) -> Any:
    """Read a JSON body. Raises BadParameter."""
    check_json(body)
    try:
        return json.loads(body)
    except ValueError:
        raise BadParameter(name="body", value="", allowed="JSON") from None


def _build_bad_parameter(error: Mapping[str, Any], find_hint: Callable[[Place], str]) -> BadParameter:
    name = next((str(part) for part in reversed(error["loc"]) if isinstance(part, str)), "")
    known = _format_context_hint(error) or find_hint(error["loc"])
    return BadParameter(name=hide_tokens(name)[:60], value=show_input(error), allowed=known)


def _format_context_hint(error: Mapping[str, Any]) -> str:
    """Write the hint that pydantic's error itself contains, in symbols."""
    if error["type"] == "json_invalid":
        return "JSON"
    limits = error.get("ctx") or {}
    if "expected" in limits:
        return str(limits["expected"]).replace("'", "").replace(" or ", ", ")
    lengths = {"max_length": "≤", "min_length": "≥"}
    return ", ".join(f"{sign} {limits[name]}" for name, sign in lengths.items() if name in limits)


# What of a request may stand in an answer: never a password, a token, a code or another secret.

LONGEST = 60
HIDDEN = "…"
_SECRET = re.compile(r"passw|pwd|secret|token|(code|key|proof|ticket)s?(?![a-z])")
_TOKEN = re.compile(rf"{TOKEN_PREFIX}[\w-]{{43}}")


def holds_token(text: str) -> bool:
    """Return whether a token stands in a part of an address, however it is quoted."""
    return _TOKEN.search(unquote(text)) is not None


def is_secret(name: object) -> bool:
    """Return whether a field of this name may hold what opens something."""
    return isinstance(name, str) and _SECRET.search(name.lower()) is not None


def show_input(error: Mapping[str, Any]) -> str:
    """Return what a refused field held, as an answer may repeat it; ``error`` is pydantic's.

    A whole body, and what has fields of its own, may hold a secret beside what is wrong: it is not repeated.
    """
    place, given = error["loc"], error.get("input")
    is_whole = error["type"] == "missing" or place in ((), ("body",))
    if is_whole or any(map(is_secret, place)) or isinstance(given, dict | list | tuple | bytes):
        return HIDDEN
    return hide_tokens(str(given))[:LONGEST]


def hide_tokens(text: str) -> str:
    """Return a text without the tokens in it."""
    return _TOKEN.sub(HIDDEN, text)


def drop_secrets(query: str) -> str:
    """Return a query without the fields that may hold a secret."""
    pairs = parse_qsl(query, keep_blank_values=True)
    kept = [pair for pair in pairs if not is_secret(pair[0]) and not any(map(holds_token, pair))]
    return query if len(kept) == len(pairs) else urlencode(kept)


def hide_address(request: Request) -> Request:
    """Return a request whose address holds no token; the same one where it holds none."""
    scope = request.scope
    path, query = str(scope["path"]), scope["query_string"].decode("latin-1")
    if not holds_token(f"{path}?{query}"):
        return request
    hidden = hide_tokens(unquote(path))
    return Request({**scope, "path": hidden, "query_string": drop_secrets(query).encode("latin-1")})
