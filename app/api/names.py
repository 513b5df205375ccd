"""Names of those who act, for people: a person's, a token's with its person's, or a word."""

from collections.abc import Iterable, Mapping

from starlette.requests import HTTPConnection

from app.api.middleware.callers import find_logins
from app.jobs.audit_log import AT_MACHINE, NOBODY, SYSTEM
from app.report.words.wording import Language, load_wording


def find_names(connection: HTTPConnection, ids: Iterable[str], language: Language) -> Mapping[str, str]:
    """Return a name for each id; an account that is gone keeps its id."""
    accounts = find_logins(connection).accounts
    words = load_wording(language, "trail")["who"]
    known = {AT_MACHINE: words["machine"], SYSTEM: words["system"], NOBODY: words["nobody"], "": ""}
    return {one: known[one] if one in known else accounts.find_name(one) or one for one in set(ids)}


def find_person_name(connection: HTTPConnection, who: str) -> str:
    """Return the name of the person who acts, by a token too; "" at the machine."""
    accounts = find_logins(connection).accounts
    return "" if who == AT_MACHINE else accounts.find_person_name(who)
