"""The permission that each route asks for, in one table; a route without a line is refused, and fails a test.

``public`` routes are answered to anybody. A WebSocket's method is written ``WS``. Where a trash keeps
nothing, what deletes asks for ``erase``, too (:func:`app.api.library.recordings.check_may_erase`).
"""

from collections.abc import Iterator, Mapping
from types import MappingProxyType
from typing import Literal

from app.access.subjects import Permission

Needed = Permission | Literal["public"]

_ROUTES: Mapping[Needed, str] = {
    "public": """
        GET  /healthz
        GET  /readyz
        GET  /vendor/{name}
        GET  /login
        POST /login
        GET  /login/once/{ticket}
        GET  /login/code
        POST /login/code
        GET  /login/enrol
        POST /login/enrol
        GET  /login/link/{ticket}
        POST /login/link/{ticket}
        GET  /login/provider
        GET  /login/provider/back
    """,
    "own": """
        POST /logout
        GET  /confirm
        POST /confirm
        GET  /confirm/provider
        GET  /account
        POST /account/told
        POST /account/password
        POST /account/second-factor
        POST /account/second-factor/drop
        POST /account/sessions/end
        POST /account/tokens
        POST /account/tokens/{token_id}/revoke
        GET  /api/v1/tokens
        POST /api/v1/tokens
        DELETE /api/v1/tokens/{token_id}
        GET  /api/v1/openapi.json
        GET  /api/v1/docs
        GET  /api/v1/formats
        GET  /api/v1/dictionary
        GET  /api/v1/problems/{code}
        GET  /api/v1/version
        GET  /help
        GET  /help/poses
        GET  /help/reading
        GET  /help/export
        GET  /problems/{code}
        GET  /example
        GET  /example/report.html
        GET  /example/report.pdf
    """,
    "upload": """
        OPTIONS /api/v1/uploads
        OPTIONS /api/v1/uploads/{upload_id}
        POST   /api/v1/uploads
        GET    /api/v1/uploads/{upload_id}
        PATCH  /api/v1/uploads/{upload_id}
        DELETE /api/v1/uploads/{upload_id}
        PUT    /api/v1/uploads/{upload_id}/words
        GET    /api/v1/uploads/{upload_id}/inspection
        POST   /api/v1/recordings
        POST   /api/v1/analyze
        PUT    /api/v1/analyze
        POST   /api/v1/analyses
        POST   /api/v1/analyses/{analysis_id}/cancel
        POST   /api/v1/analyses/{analysis_id}/retry
        POST   /api/v1/batches
        POST   /api/v1/batches/{batch_id}/retry-failed
        POST   /api/v1/validations
        WS     /api/v1/live
        POST   /analyses/{analysis_id}/cancel
        POST   /analyses/{analysis_id}/retry
        POST   /batches/{batch_id}/retry
        POST   /sample
        GET    /validations
        POST   /validations
        GET    /live
    """,
    "read": """
        GET  /api/v1/recordings
        GET  /api/v1/recordings/{recording_id}
        GET  /api/v1/recordings/{recording_id}/inspection
        GET  /api/v1/recordings/{recording_id}/periods
        GET  /api/v1/analyses
        GET  /api/v1/analyses/{analysis_id}
        GET  /api/v1/analyses/{analysis_id}/events
        GET  /api/v1/analyses/{analysis_id}/report.html
        GET  /api/v1/analyses/{analysis_id}/report.pdf
        GET  /api/v1/analyses/{analysis_id}/answer.txt
        GET  /api/v1/analyses/{analysis_id}/settings.yaml
        GET  /api/v1/batches/{batch_id}
        GET  /api/v1/validations/{validation_id}
        GET  /api/v1/columns
        GET  /api/v1/columns/{header}
        GET  /api/v1/columns/{header}/profile.json
        GET  /api/v1/compare/{name}
        GET  /api/v1/pair/{name}
        GET  /api/v1/profile/{name}
        GET  /api/v1/live/{session_id}/difference
        GET  /
        GET  /rows
        GET  /analyses/{analysis_id}
        GET  /analyses/{analysis_id}/curve
        GET  /analyses/{analysis_id}/report.html
        GET  /analyses/{analysis_id}/stillness
        GET  /analyses/{analysis_id}/share
        GET  /analyses/{analysis_id}/columns
        GET  /batches
        GET  /batches/{batch_id}
        POST /library/views
        POST /library/views/{view_id}/drop
        GET  /trash
        GET  /beside/{kind}
        GET  /beside/{kind}/report.{form}
        GET  /days
        GET  /days/report.{form}
        GET  /columns
        GET  /validations/{validation_id}
        GET  /validations/{validation_id}/curve
        GET  /validations/{validation_id}/plot.svg
        GET  /api/v1/analyses/{analysis_id}/release
        GET  /api/v1/recordings/{recording_id}/hold
        GET  /api/v1/retention
        GET  /retention
    """,
    "correct": """
        PATCH  /api/v1/recordings/{recording_id}
        DELETE /api/v1/recordings/{recording_id}
        POST   /api/v1/recordings/{recording_id}/restore
        PUT    /api/v1/recordings/{recording_id}/periods
        PATCH  /api/v1/columns/{header}
        DELETE /api/v1/columns/{header}
        POST   /analyses/{analysis_id}/withdraw
        POST   /analyses/{analysis_id}/again
        POST   /analyses/{analysis_id}/pose
        POST   /analyses/{analysis_id}/moved
        POST   /analyses/{analysis_id}/other-pose
        POST   /analyses/{analysis_id}/diary
        POST   /analyses/{analysis_id}/diary.csv
        POST   /analyses/{analysis_id}/columns
        POST   /analyses/{analysis_id}/columns/use
        POST   /batches/{batch_id}/participants
        POST   /library/acts/{act}
        GET    /recordings/{recording_id}/delete
        POST   /recordings/{recording_id}/delete
        POST   /recordings/{recording_id}/restore
        POST   /beside/compare/align
        POST   /columns/{header}
        POST   /columns/{header}/delete
    """,
    "release": """
        POST /analyses/{analysis_id}/conclude
        POST /analyses/{analysis_id}/dismiss
        DELETE /api/v1/analyses/{analysis_id}/conclusion-draft
        POST /analyses/{analysis_id}/release
        POST /api/v1/analyses/{analysis_id}/release
        DELETE /api/v1/analyses/{analysis_id}/release
    """,
    "export": """
        GET  /api/v1/recordings/{recording_id}/file
        GET  /api/v1/analyses/{analysis_id}/results.json
        GET  /api/v1/analyses/{analysis_id}/elevation.parquet
        GET  /api/v1/analyses/{analysis_id}/fhir.json
        GET  /api/v1/analyses/{analysis_id}/datapackage.json
        GET  /api/v1/analyses/{analysis_id}/bundle.zip
        GET  /api/v1/analyses/{analysis_id}/periods.csv
        GET  /api/v1/analyses/{analysis_id}/elevation.csv.gz
        GET  /api/v1/analyses/{analysis_id}/summary.csv
        GET  /api/v1/analyses/{analysis_id}/summary_fr.csv
        GET  /api/v1/analyses/{analysis_id}/summary.xlsx
        GET  /api/v1/analyses/{analysis_id}/summary.parquet
        GET  /api/v1/analyses/{analysis_id}/dictionary.csv
        GET  /api/v1/analyses/{analysis_id}/redcap_import.csv
        GET  /api/v1/analyses/{analysis_id}/redcap_dictionary.csv
        GET  /api/v1/batches/{batch_id}/summary.csv
        GET  /api/v1/batches/{batch_id}/problems.csv
        GET  /api/v1/validations/{validation_id}/{name}
        GET  /api/v1/compare/comparison.json
        GET  /api/v1/pair/pair.json
        GET  /api/v1/profile/profile.json
        GET  /api/v1/profile/{name}.csv
        GET  /library/{name}.csv
        GET  /library/reports.zip
        GET  /library/recordings.zip
        POST /library/acts/reports.zip
        POST /library/acts/{name}.csv
        GET  /days/{name}.csv
        GET  /api/v1/webhooks
        POST /api/v1/webhooks
        DELETE /api/v1/webhooks/{webhook_id}
    """,
    "erase": """
        GET  /recordings/{recording_id}/purge
        POST /recordings/{recording_id}/purge
        POST /recordings/{recording_id}/hold
        PUT    /api/v1/recordings/{recording_id}/hold
        DELETE /api/v1/recordings/{recording_id}/hold
        PUT  /api/v1/retention/{kind}
        POST /retention
    """,
    "aggregate": """
        GET /aggregate
        GET /api/v1/studies/{study_id}/aggregate.json
    """,
    "people": """
        GET  /people
        POST /people
        POST /people/{person_id}/roles
        POST /people/{person_id}/link
        POST /people/{person_id}/end
        POST /people/{person_id}/resume
    """,
    "trail": """
        GET /metrics
        GET /trail
        GET /api/v1/trail
        GET /api/v1/trail/proof
        GET /api/v1/trail/trail.csv
        GET /api/v1/trail/trail.jsonl
    """,
}


_CONFIRMED = """
    GET  /recordings/{recording_id}/purge
    POST /recordings/{recording_id}/purge
    POST /recordings/{recording_id}/hold
    DELETE /api/v1/recordings/{recording_id}/hold
    POST /retention
    PUT  /api/v1/retention/{kind}
    GET  /library/{name}.csv
    GET  /library/reports.zip
    GET  /library/recordings.zip
    POST /library/acts/reports.zip
    POST /library/acts/{name}.csv
    GET  /api/v1/batches/{batch_id}/summary.csv
    GET  /api/v1/batches/{batch_id}/problems.csv
    GET  /days/{name}.csv
    GET  /api/v1/profile/profile.json
    GET  /api/v1/profile/{name}.csv
    POST /api/v1/webhooks
    GET  /people
    POST /people
    POST /people/{person_id}/roles
    POST /people/{person_id}/link
    POST /people/{person_id}/end
    POST /people/{person_id}/resume
    POST /account/second-factor
    POST /account/second-factor/drop
    POST /account/sessions/end
    POST /account/tokens
    POST /api/v1/tokens
"""
"""What a person is asked the password for again.

To erase; to take the data of many recordings out; to open a way out that stays (a token, a webhook); to let
people in. The files of one recording, the original and its ZIP too, are downloads like its PDF: they are not
asked about.
"""


def _read_lines(lines: str) -> Iterator[tuple[str, str]]:
    for line in filter(None, map(str.split, lines.splitlines())):
        yield line[0], line[1]


NEEDED: Mapping[tuple[str, str], Needed] = MappingProxyType(
    {route: needed for needed, lines in _ROUTES.items() for route in _read_lines(lines)}
)
"""By method and path, as the route is declared."""
CONFIRMED = frozenset(_read_lines(_CONFIRMED))


def find_needed(method: str, path: str) -> Needed | None:
    """Give what a route asks for; None for one that the table does not know."""
    return NEEDED.get((method, path))
