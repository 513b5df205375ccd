"""Columns of words, sealed on their way into the database and opened on their way out; columns of digests."""

from typing import Any

from sqlalchemy import Dialect, Engine, String, Text, TypeDecorator

from app.storage.labels import PLAIN, Label, LabelSealer, is_sealed


class SealedText(TypeDecorator[str]):
    """Text that only comes in as a :class:`~app.storage.labels.Label`: nothing is stored open by mistake.

    ``gone`` is read where the key was destroyed. What is sealed already (a copy of a row) passes unchanged.
    """

    impl = Text
    cache_ok = True

    def __init__(self, gone: str = "") -> None:
        super().__init__()
        self.gone = gone

    def process_bind_param(self, value: Any, dialect: Dialect) -> str | None:
        """Seal a label."""
        if isinstance(value, Label):
            return _find_sealer(dialect).seal(value)
        if value is None or value in PLAIN or is_sealed(value):
            return None if value is None else str(value)
        raise TypeError("words go into this column as a Label")

    def process_result_value(self, value: Any, dialect: Dialect) -> str | None:
        """Open what was sealed."""
        return None if value is None else _find_sealer(dialect).open(str(value), self.gone)


class KeyedDigest(TypeDecorator[str]):
    """A digest that is keyed on its way in, and so is what it is compared with: rows are found by it.

    It comes out as it is stored; what is keyed already passes unchanged.
    """

    impl = String
    cache_ok = True

    def __init__(self) -> None:
        super().__init__(64)

    def process_bind_param(self, value: Any, dialect: Dialect) -> str | None:
        """Key a digest."""
        return None if value is None else _find_sealer(dialect).key_digest(str(value))


def use_sealer(engine: Engine, sealer: LabelSealer) -> None:
    """Let an engine seal and open with the keys of its organisation."""
    engine.dialect.acromion_sealer = sealer  # type: ignore[attr-defined]


def find_sealer(engine: Engine) -> LabelSealer:
    """Give what an engine seals with."""
    return _find_sealer(engine.dialect)


def _find_sealer(dialect: Dialect) -> LabelSealer:
    sealer: LabelSealer = dialect.acromion_sealer  # type: ignore[attr-defined]
    return sealer
