"""Hooks for schemathesis: how to send the bytes of an upload."""

from typing import Any

import schemathesis


@schemathesis.serializer("application/offset+octet-stream")
def serialize_bytes(_context: Any, value: Any) -> bytes:
    """Return the value as bytes."""
    return value if isinstance(value, bytes) else str(value).encode()
