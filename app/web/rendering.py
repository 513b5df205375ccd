"""From a template and its values to a page: the one place that knows how pages are made."""

from pathlib import Path
from typing import Any
from urllib.parse import urlencode

from fastapi import Request
from fastapi.responses import HTMLResponse
from jinja2 import Environment, FileSystemLoader, StrictUndefined

from app.api.services import LANGUAGE_COOKIE
from app.report.numbers import format_angle, format_duration, format_number, format_percent
from app.report.wording import Language, fill, load_wording
from app.web.assets import find_assets, find_plotly, list_style_ids

YEAR_S = 365 * 24 * 3600

_PACKAGED = Path(__file__).resolve().parents[1] / "templates" / "web"
_CHECKOUT = Path(__file__).resolve().parents[2] / "templates" / "web"

pages = Environment(
    loader=FileSystemLoader(_PACKAGED if _PACKAGED.is_dir() else _CHECKOUT),
    autoescape=True,
    undefined=StrictUndefined,
    trim_blocks=True,
    lstrip_blocks=True,
)
pages.globals["fill"] = fill
pages.globals["list_style_ids"] = list_style_ids
pages.globals |= {
    "percent": format_percent,
    "angle": format_angle,
    "duration": format_duration,
    "number": format_number,
}


def show_page(
    request: Request, template: str, language: Language, values: dict[str, Any], status: int = 200
) -> HTMLResponse:
    """Render a template with the words of the language, and remember a choice of language."""
    body = pages.get_template(template).render(
        values,
        words=load_wording(language, "page"),
        language=language,
        base=find_base(request),
        static=find_base(request) + find_assets(),
        plotly=find_base(request) + find_plotly(),
        language_link=_turn_language(request, language),
    )
    response = HTMLResponse(body, status, headers={"Content-Language": language})
    if request.query_params.get("lang") == language:
        response.set_cookie(
            LANGUAGE_COOKIE,
            language,
            max_age=YEAR_S,
            httponly=True,
            samesite="lax",
            path=find_base(request) or "/",
        )
    return response


def find_base(request: Request) -> str:
    """Give the path under which a proxy serves us, "" at the root; every address of ours begins with it."""
    return str(request.scope.get("root_path", "")).rstrip("/")


def _turn_language(request: Request, language: Language) -> str:
    """Give the same page in the other language."""
    kept = {name: value for name, value in request.query_params.items() if name != "lang"}
    return "?" + urlencode(kept | {"lang": "en" if language == "fr" else "fr"})
