"""What a tus client says about the file, in ``Upload-Metadata``."""

import base64
import binascii

from app.api.problems import take_model
from app.api.recording_views import RecordingWords
from app.errors import BadParameter

NAMES = {"filename": "file_name", "name": "file_name"} | {name: name for name in RecordingWords.model_fields}


def read_metadata(header: str) -> RecordingWords:
    """Read ``name base64,name base64``; what is not ours (``filetype``) is left aside.

    Raises
    ------
    BadParameter
    """
    pairs = dict(_read_pair(pair) for pair in header.split(",") if pair.strip())
    known = {NAMES[name]: value for name, value in pairs.items() if name in NAMES and value}
    return take_model(RecordingWords, known)


def _read_pair(pair: str) -> tuple[str, str]:
    name, _, coded = pair.strip().partition(" ")
    try:
        return name, base64.b64decode(coded, validate=True).decode("utf-8")
    except (binascii.Error, ValueError):
        raise BadParameter(name="Upload-Metadata", value=pair[:60], allowed="name base64") from None
