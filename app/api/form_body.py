"""A recording in a form as browsers and ``curl -F`` send it: its file goes to the disk as it comes.

Reading the form whole first would write every byte twice, and the first time to the folder for temporary
files, which is small in a container.
"""

import hashlib
from collections.abc import AsyncIterator, Callable

from fastapi import Request
from python_multipart.exceptions import FormParserError
from python_multipart.multipart import MultipartParser, parse_options_header

from app.api.upload import copy_chunks
from app.errors import BadParameter, BrokenUpload, WrongDigest

MOST_WORDS, MOST_WORD_BYTES = 20, 4096


class RecordingForm:
    """One file and a few words; any order.

    ``digest`` is the SHA-256 that the client has told of the whole form, in hex, or "".
    """

    def __init__(self, content_type: str, digest: str = "") -> None:
        _, options = parse_options_header(content_type)
        boundary = options.get(b"boundary", b"")
        if not boundary:
            raise BadParameter(name="Content-Type", value=content_type[:60], allowed="boundary=…")
        self._digest, self._sha256 = digest, hashlib.sha256()
        self.words: dict[str, str] = {}
        self.file_name: str | None = None
        self._piece, self._word = bytearray(), bytearray()
        self._name, self._in_file, self._ended = "", False, False
        self._header, self._value = bytearray(), bytearray()
        self._parser = MultipartParser(
            boundary,
            {
                "on_part_begin": self._begin,
                "on_header_field": lambda octets, start, end: self._header.extend(octets[start:end]),
                "on_header_value": lambda octets, start, end: self._value.extend(octets[start:end]),
                "on_header_end": self._end_header,
                "on_part_data": self._take,
                "on_part_end": self._end_part,
                "on_end": self._end,
            },
        )

    async def copy_file(self, request: Request, write: Callable[[bytes], None]) -> None:
        """Write the file as it comes.

        Raises
        ------
        BadParameter, BrokenUpload, WrongDigest
        """
        await copy_chunks(self._read_file(request), write)
        self._check_whole()

    async def _read_file(self, request: Request) -> AsyncIterator[bytes]:
        """Give what each chunk of the form holds of the file."""
        async for chunk in request.stream():
            if self._digest:
                self._sha256.update(chunk)
            try:
                self._parser.write(chunk)
            except FormParserError:
                raise BadParameter(name="form", value="", allowed="multipart/form-data") from None
            yield self._take_piece()

    def _check_whole(self) -> None:
        if not self._ended:
            raise BrokenUpload
        if self._digest not in ("", self._sha256.hexdigest()):
            raise WrongDigest
        if self.file_name is None:
            raise BadParameter(name="form", value=", ".join(self.words)[:60], allowed="file")

    def _take_piece(self) -> bytes:
        piece, self._piece = bytes(self._piece), bytearray()
        return piece

    def _begin(self) -> None:
        self._name, self._in_file = "", False
        self._word.clear()

    def _end_header(self) -> None:
        if bytes(self._header).lower() == b"content-disposition":
            _, options = parse_options_header(bytes(self._value))
            self._name = options.get(b"name", b"").decode("utf-8", "replace")
            if b"filename" in options:
                self._open_file(options[b"filename"].decode("utf-8", "replace"))
        self._header.clear()
        self._value.clear()

    def _open_file(self, file_name: str) -> None:
        if self.file_name is not None:
            raise BadParameter(name=self._name[:60], value=file_name[:60], allowed="1")
        self.file_name, self._in_file = file_name, True

    def _take(self, octets: bytes, start: int, end: int) -> None:
        if self._in_file:
            self._piece += octets[start:end]
            return
        self._word += octets[start:end]
        if len(self._word) > MOST_WORD_BYTES or len(self.words) >= MOST_WORDS:
            raise BadParameter(name=self._name[:60], value="", allowed=f"≤ {MOST_WORD_BYTES}")

    def _end_part(self) -> None:
        if not self._in_file:
            self.words[self._name] = self._word.decode("utf-8", "replace").strip()

    def _end(self) -> None:
        self._ended = True
