"""Labels: names, subject codes and other words of people, sealed wherever rows hold them.

A label is sealed with the key of what it belongs to: a recording, a study, or the organisation (``LABELS``).
The sealed text names the key, so that it can be opened wherever it stands, and opens no more once that key is
destroyed. Words that say nothing (:data:`PLAIN`) stay as they are.

Where rows are found by a digest of words, that is keyed, too: without the key nobody can try a guess.
"""

import base64
import hmac
import threading
from collections import OrderedDict
from collections.abc import Collection
from dataclasses import dataclass, field

from app.storage.keys import KeyStore, RecordingKey
from app.storage.store import BrokenSeal

LABELS = "labels"
"""The key of words that belong to the organisation as a whole."""
PLAIN = frozenset({"", "[]", "{}", "null"})
MARK = "~1~"
DIGEST_MARK = "~k1~"
MOST_KEYS = 200_000


@dataclass(frozen=True, slots=True)
class Label:
    """Words on their way into a row, and the id of what they belong to."""

    owner: str
    text: str = field(repr=False)


class LabelSealer:
    """Seals and opens the labels of one organisation; keys in use are held in memory."""

    def __init__(self, keys: KeyStore) -> None:
        self.keys = keys
        self._held: OrderedDict[str, RecordingKey | None] = OrderedDict()
        self._digest_key = b""
        self._turn = threading.Lock()

    def seal(self, label: Label) -> str:
        """Give the text as a row holds it."""
        if label.text in PLAIN:
            return label.text
        key = self._create(label.owner)
        sealed = key.seal(label.text.encode(), LABELS)
        return f"{MARK}{label.owner}~{base64.b64encode(sealed).decode()}"

    def open(self, stored: str, gone: str) -> str:
        """Give the words of a stored text; ``gone`` where its key is destroyed or the text damaged.

        A text of an earlier release is given as it is.
        """
        if not is_sealed(stored):
            return stored
        owner, _, body = stored.removeprefix(MARK).partition("~")
        key = self._find(owner)
        try:
            return gone if key is None else key.open(base64.b64decode(body), LABELS).decode()
        except (BrokenSeal, ValueError):
            return gone

    def seal_bytes(self, content: bytes) -> bytes:
        """Seal bytes that belong to the organisation as a whole."""
        return self.seal(Label(LABELS, base64.b64encode(content).decode())).encode() if content else b""

    def open_bytes(self, stored: bytes) -> bytes:
        """Open what :meth:`seal_bytes` gave; bytes of an earlier release are given as they are."""
        if not stored.startswith(MARK.encode()):
            return stored
        return base64.b64decode(self.open(stored.decode(), gone=""))

    def key_digest(self, digest: str) -> str:
        """Give a digest as a row holds it, keyed; one that is keyed already, and none at all, as they are.

        A "-" before it says something of what was digested, and stays before it.
        """
        if not digest or is_keyed(digest):
            return digest
        sign = "-" if digest.startswith("-") else ""
        return sign + write_keyed(self.sign("row", digest))

    def sign(self, about: str, text: str) -> bytes:
        """Give the HMAC-SHA256 of a text; ``about`` says what it is, and is bound to it.

        Its key comes from that of :data:`LABELS`, which goes with the rows to another installation.
        """
        self._digest_key = self._digest_key or self._create(LABELS).derive(b"", b"digest")
        return hmac.digest(self._digest_key, f"{about}\n{text}".encode(), "sha256")

    def destroy(self, owners: Collection[str]) -> None:
        """Destroy the keys of studies that are gone; those of recordings are destroyed with their bytes."""
        with self._turn:
            self._held.clear()
        self.keys.destroy(*owners)

    def hold_all(self) -> None:
        """Read every key at once, before many labels are opened."""
        if len(self._held) < MOST_KEYS // 2:
            for owner, key in self.keys.find_all().items():
                self._hold(owner, key)

    def _create(self, owner: str) -> RecordingKey:
        """Give the key of an owner, which is made at its first use."""
        return self._find(owner) or self._hold(owner, self.keys.create(owner))

    def _find(self, owner: str) -> RecordingKey | None:
        with self._turn:
            held = self._held.get(owner)
        if held is not None:
            return held
        found = self.keys.find(owner)
        return None if found is None else self._hold(owner, found)

    def _hold(self, owner: str, key: RecordingKey) -> RecordingKey:
        with self._turn:
            self._held[owner] = key
            if len(self._held) > MOST_KEYS:
                self._held.popitem(last=False)
        return key


def write_keyed(digest: bytes) -> str:
    """Write a keyed digest as a row holds it."""
    return DIGEST_MARK + base64.urlsafe_b64encode(digest).decode().rstrip("=")


def is_keyed(stored: str) -> bool:
    """Tell whether a stored digest is keyed."""
    return stored.removeprefix("-").startswith(DIGEST_MARK)


def is_sealed(stored: str) -> bool:
    """Tell whether a stored text is sealed."""
    return stored.startswith(MARK)
