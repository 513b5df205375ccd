"""Drafts of the forms on a recording's page, which their scripts save while a person types."""

from typing import Annotated, Literal

from fastapi import APIRouter, Depends, Path, Response
from fastapi.responses import JSONResponse

from acromion.app.errors import BadParameter, NotHere
from acromion.app.http.middleware.access import UsedSubject
from acromion.app.http.pages.rendering import read_body
from acromion.app.library.drafts import LONGEST_TEXT
from acromion.app.services import Services, UsedServices

router = APIRouter(include_in_schema=False, prefix="/drafts/{kind}/{place}")
Kind = Literal["conclusion", "correction"]
Place = Annotated[str, Path(pattern=r"^(rec|an)_[0-9a-f]{1,28}$")]
"""The recording, or the analysis whose settings the form corrects."""


@router.get("")
def get_draft(kind: Kind, place: Place, services: UsedServices, subject: UsedSubject) -> Response:
    """Return your draft of a form, or 204 without one."""
    found = services.drafts.find(subject.id, f"{kind}:{place}")
    return JSONResponse({"text": found.text, "at": found.at}) if found else Response(status_code=204)


@router.put("", status_code=204)
def put_draft(
    kind: Kind,
    place: Place,
    services: UsedServices,
    subject: UsedSubject,
    body: Annotated[bytes, Depends(read_body)],
) -> Response:
    """Save your draft of a form."""
    text = body.decode("utf-8", "replace")
    if len(text) > LONGEST_TEXT:
        raise BadParameter(name="text", value="", allowed=f"<= {LONGEST_TEXT}")
    services.drafts.put(subject.id, f"{kind}:{place}", find_recording(services, place), text)
    return Response(status_code=204)


@router.delete("", status_code=204)
def delete_draft(kind: Kind, place: Place, services: UsedServices, subject: UsedSubject) -> Response:
    """Delete your draft of a form; without one nothing happens."""
    services.drafts.drop(subject.id, f"{kind}:{place}")
    return Response(status_code=204)


def find_recording(services: Services, place: str) -> str:
    """Return the recording that a draft belongs to. Raises NotHere."""
    recording_id = services.store.find_recording(place) if place.startswith("an_") else place
    if not recording_id:
        raise NotHere(id=place)
    return services.recordings.get(recording_id).id
