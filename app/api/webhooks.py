"""Webhooks: addresses that are notified when an analysis or a batch ends."""

from typing import Annotated, Literal

from fastapi import APIRouter, Response
from fastapi.responses import JSONResponse
from pydantic import BaseModel, ConfigDict, Field

from app.api.middleware.problems import PROBLEM_RESPONSES
from app.delivery import check_address
from app.jobs.webhooks import EVENTS, USUAL_EVENTS, Webhook
from app.services import UsedServices
from app.storage.server_secret import ServerSecret

router = APIRouter(prefix="/api/v1/webhooks", responses=PROBLEM_RESPONSES, tags=["webhooks"])
EventName = Literal["analysis.finished", "batch.finished", "live.cue"]


class WebhookWish(BaseModel):
    """An address, and of what it wants to be told."""

    model_config = ConfigDict(extra="forbid")

    url: Annotated[str, Field(max_length=2000, description="http or https")]
    events: Annotated[list[EventName], Field(min_length=1, max_length=len(EVENTS))] = list(USUAL_EVENTS)


class WebhookView(BaseModel):
    """A webhook. ``secret`` is shown once, when it is made."""

    id: str
    url: str
    events: list[EventName]
    created_at: str
    secret: str | None = None


class WebhookList(BaseModel):
    """Every webhook."""

    items: list[WebhookView]


@router.post("", status_code=201)
def create_webhook(body: WebhookWish, services: UsedServices) -> WebhookView:
    """Tell an address when something ends: ids only, signed by the secret (Standard Webhooks)."""
    check_address(body.url, allow_private=services.settings.webhooks_may_be_private)
    secret = ServerSecret(services.settings.data_dir)
    hook = services.webhooks.add(body.url, tuple(dict.fromkeys(body.events)), secret)
    view = _view(hook)
    view.secret = hook.secret
    headers = {"Location": f"/api/v1/webhooks/{hook.id}"}
    return JSONResponse(view.model_dump(), 201, headers)  # type: ignore[return-value]


@router.get("", response_model_exclude_none=True)
def list_webhooks(services: UsedServices) -> WebhookList:
    """Give every webhook, without its secret."""
    return WebhookList(items=[_view(hook) for hook in services.webhooks.find_all()])


@router.delete("/{webhook_id}", status_code=204)
def delete_webhook(webhook_id: str, services: UsedServices) -> Response:
    """Tell an address nothing more."""
    services.webhooks.drop(webhook_id)
    return Response(status_code=204)


def _view(hook: Webhook) -> WebhookView:
    return WebhookView(id=hook.id, url=hook.url, events=list(hook.events), created_at=hook.created_at)
