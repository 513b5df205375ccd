"""Drafts: text that a person typed on the page of a recording and has not sent.

A draft is kept until it is sent, discarded or two weeks old. Each person has separate drafts, which nobody
else can read. They are deleted with the recording.
"""

from dataclasses import dataclass
from datetime import UTC, datetime, timedelta

from sqlalchemy import delete, select
from sqlalchemy.dialects import postgresql, sqlite

from acromion.app.library.database.tables import drafts
from acromion.app.library.rows import RowStore, format_now

TERM = timedelta(days=14)
LONGEST_TEXT = 60_000


@dataclass(frozen=True, slots=True)
class Draft:
    """The content of a form as its script wrote it, and when it was saved."""

    text: str
    at: str


class DraftStore(RowStore):
    """Drafts in the database, by person and form (``conclusion:rec_…``)."""

    def find(self, person: str, form: str) -> Draft | None:
        """Return a draft; None if there is none, or an old one."""
        mine = (drafts.c.person == person, drafts.c.form == form, drafts.c.at >= _find_oldest())
        row = self._read_one(select(drafts.c.text, drafts.c.at).where(*mine))
        return None if row is None else Draft(row.text, row.at)

    def put(self, person: str, form: str, recording_id: str, text: str) -> None:
        """Save a draft, replacing the earlier one; delete everybody's old ones."""
        make_insert = postgresql.insert if self._engine.dialect.name == "postgresql" else sqlite.insert
        values = {"recording_id": recording_id, "text": text, "at": format_now()}
        saved = make_insert(drafts).values(person=person, form=form, **values)
        with self._engine.begin() as connection:
            connection.execute(delete(drafts).where(drafts.c.at < _find_oldest()))
            key = [drafts.c.person, drafts.c.form]
            connection.execute(saved.on_conflict_do_update(index_elements=key, set_=values))

    def drop(self, person: str, form: str) -> None:
        """Delete a draft; ignore a missing one."""
        self._write(delete(drafts).where(drafts.c.person == person, drafts.c.form == form))


def _find_oldest() -> str:
    return (datetime.now(UTC) - TERM).isoformat(timespec="microseconds")
