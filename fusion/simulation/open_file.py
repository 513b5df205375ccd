"""What the writers of text logs share: a file that is open from the start to the end of a ``with``."""

from pathlib import Path
from types import TracebackType
from typing import Self


class OpenFile:
    """A file with its head written, to be written on; a context manager."""

    def __init__(self, path: Path, head: bytes) -> None:
        self._file = path.open("wb")
        self._file.write(head)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._file.close()
