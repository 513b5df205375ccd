"""What is known of the files of an analysis before they are read; whoever only hands it on needs no numpy."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from app.storage.decoded import DecodedCache


@dataclass(frozen=True, slots=True)
class KnownLogs:
    """What is known of the files before they are read: their SHA-256, and the cache of their samples."""

    digests: tuple[str, ...] = ()
    cache: "DecodedCache | None" = None


NOTHING_KNOWN = KnownLogs()
