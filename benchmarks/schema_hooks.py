"""What schemathesis must be told: how the bytes of an upload are sent."""

from typing import Any

import schemathesis


@schemathesis.serializer("application/offset+octet-stream")
def serialize_bytes(_context: Any, value: Any) -> bytes:
    """Send the value as bytes."""
    return value if isinstance(value, bytes) else str(value).encode()
