"""The required permission and the audit act of each route, in one table; a test fails for a missing route.

A line has method, path and act. ``public`` routes are open to everyone. A WebSocket has the method ``WS``. If
the trash is turned off, deleting also needs ``erase``
(:func:`acromion.app.http.api.library.recordings.check_may_erase`).

The act is what the response adds to the audit log (:mod:`acromion.app.http.middleware.access`). ``rows``: the
change itself adds its lines, in its own transaction. ``none``: no personal data is read except one's own
draft.

``again``: the person must confirm the password first: to erase, to export the data of many recordings, to
create lasting access to the data (a token, a webhook), or to manage accounts. The files of one recording,
including the original and its ZIP, are ordinary downloads like its PDF.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Literal, cast

from acromion.app.accounts.subjects import Permission
from acromion.app.library.audit_log import ACTS, Act

Needed = Permission | Literal["public"]

_ROUTES: Mapping[Needed, str] = {
    "public": """
        GET    /healthz                                                   none
        GET    /readyz                                                    none
        GET    /vendor/{name}                                             none
        GET    /login                                                     none
        POST   /login                                                     rows
        GET    /login/once/{ticket}                                       none
        GET    /login/code                                                none
        POST   /login/code                                                rows
        GET    /login/enrol                                               none
        POST   /login/enrol                                               rows
        GET    /login/link/{ticket}                                       none
        POST   /login/link/{ticket}                                       rows
        GET    /login/provider                                            none
        GET    /login/provider/back                                       none
    """,
    "own": """
        POST   /logout                                                    rows
        GET    /confirm                                                   none
        POST   /confirm                                                   none
        GET    /confirm/provider                                          none
        GET    /account                                                   none
        POST   /account/told                                              rows
        POST   /account/password                                          rows
        POST   /account/second-factor                                     rows again
        POST   /account/second-factor/drop                                rows again
        POST   /account/sessions/end                                      rows again
        POST   /account/tokens                                            rows again
        POST   /account/tokens/{token_id}/revoke                          rows
        GET    /api/v1/tokens                                             none
        POST   /api/v1/tokens                                             rows again
        DELETE /api/v1/tokens/{token_id}                                  rows
        GET    /drafts/{kind}/{place}                                     none
        PUT    /drafts/{kind}/{place}                                     none
        DELETE /drafts/{kind}/{place}                                     none
        GET    /api/v1/openapi.json                                       none
        GET    /api/v1/docs                                               none
        GET    /api/v1/formats                                            none
        GET    /api/v1/dictionary                                         none
        GET    /api/v1/problems/{code}                                    none
        GET    /api/v1/version                                            none
        GET    /help                                                      none
        GET    /help/poses                                                none
        GET    /help/reading                                              none
        GET    /help/export                                               none
        GET    /problems/{code}                                           none
        GET    /example                                                   none
        GET    /example/report.html                                       none
        GET    /example/report.pdf                                        none
    """,
    "upload": """
        OPTIONS /api/v1/uploads                                            none
        OPTIONS /api/v1/uploads/{upload_id}                                none
        POST   /api/v1/uploads                                            rows
        GET    /api/v1/uploads/{upload_id}                                none
        PATCH  /api/v1/uploads/{upload_id}                                rows
        DELETE /api/v1/uploads/{upload_id}                                rows
        GET    /api/v1/uploads/{upload_id}/inspection                     none
        POST   /api/v1/recordings                                         rows
        POST   /api/v1/analyze                                            rows
        PUT    /api/v1/analyze                                            rows
        POST   /api/v1/analyses                                           rows
        POST   /api/v1/analyses/{analysis_id}/cancel                      rows
        POST   /api/v1/analyses/{analysis_id}/retry                       rows
        POST   /api/v1/batches                                            rows
        POST   /api/v1/batches/{batch_id}/retry-failed                    rows
        POST   /api/v1/validations                                        rows
        WS     /api/v1/live                                               rows
        POST   /analyses/{analysis_id}/cancel                             rows
        POST   /analyses/{analysis_id}/retry                              rows
        POST   /studies/{batch_id}/retry                                  rows
        POST   /sample                                                    rows
        GET    /validations                                               none
        POST   /validations                                               rows
        GET    /live                                                      none
    """,
    "read": """
        GET    /api/v1/recordings                                         list.read
        GET    /api/v1/recordings/{recording_id}                          recording.read
        GET    /api/v1/recordings/{recording_id}/inspection               recording.read
        GET    /api/v1/recordings/{recording_id}/periods                  recording.read
        GET    /api/v1/analyses                                           list.read
        GET    /api/v1/analyses/{analysis_id}                             report.read
        GET    /api/v1/analyses/{analysis_id}/events                      report.read
        GET    /api/v1/analyses/{analysis_id}/report.html                 report.read
        GET    /api/v1/analyses/{analysis_id}/report.pdf                  file.exported
        GET    /api/v1/analyses/{analysis_id}/answer.txt                  file.exported
        GET    /api/v1/analyses/{analysis_id}/settings.yaml               file.exported
        GET    /api/v1/batches                                            list.read
        GET    /api/v1/batches/{batch_id}                                 list.read
        GET    /api/v1/validations/{validation_id}                        report.read
        GET    /api/v1/columns                                            list.read
        GET    /api/v1/columns/{header}                                   list.read
        GET    /api/v1/columns/{header}/profile.json                      file.exported
        GET    /api/v1/compare/{name}                                     report.read
        GET    /api/v1/pair/{name}                                        report.read
        GET    /api/v1/profile/{name}                                     report.read
        GET    /api/v1/live/{session_id}/difference                       report.read
        GET    /                                                          list.read
        GET    /rows                                                      list.read
        GET    /analyses/{analysis_id}                                    report.read
        GET    /recordings/{recording_id}/finish                          report.read
        GET    /analyses/{analysis_id}/curve                              report.read
        GET    /analyses/{analysis_id}/report.html                        report.read
        GET    /analyses/{analysis_id}/stillness                          report.read
        GET    /analyses/{analysis_id}/share                              report.read
        GET    /analyses/{analysis_id}/columns                            report.read
        GET    /persons                                                   list.read
        GET    /person                                                    list.read
        GET    /studies                                                   list.read
        GET    /studies/{batch_id}                                        list.read
        POST   /library/views                                             rows
        POST   /library/views/{view_id}/drop                              rows
        GET    /trash                                                     list.read
        GET    /beside/{kind}                                             report.read
        GET    /beside/{kind}/report.{form}                               report.read
        GET    /days                                                      report.read
        GET    /days/report.{form}                                        report.read
        GET    /columns                                                   list.read
        GET    /validations/{validation_id}                               report.read
        GET    /validations/{validation_id}/curve                         report.read
        GET    /validations/{validation_id}/plot.svg                      report.read
        GET    /api/v1/analyses/{analysis_id}/release                     report.read
        GET    /api/v1/recordings/{recording_id}/hold                     recording.read
        GET    /api/v1/retention                                          list.read
        GET    /api/v1/retention/{kind}/due                               list.read
        GET    /retention                                                 list.read
    """,
    "correct": """
        PATCH  /api/v1/recordings/{recording_id}                          rows
        DELETE /api/v1/recordings/{recording_id}                          rows
        POST   /api/v1/recordings/{recording_id}/restore                  rows
        PUT    /api/v1/recordings/{recording_id}/periods                  rows
        PATCH  /api/v1/columns/{header}                                   rows
        DELETE /api/v1/columns/{header}                                   rows
        POST   /analyses/{analysis_id}/withdraw                           rows
        POST   /analyses/{analysis_id}/again                              rows
        POST   /analyses/{analysis_id}/pose                               rows
        POST   /analyses/{analysis_id}/moved                              rows
        POST   /analyses/{analysis_id}/other-pose                         rows
        POST   /analyses/{analysis_id}/diary                              rows
        POST   /analyses/{analysis_id}/diary.csv                          file.exported
        POST   /analyses/{analysis_id}/columns                            rows
        POST   /analyses/{analysis_id}/columns/use                        rows
        POST   /studies/{batch_id}/participants                           rows
        POST   /studies/{batch_id}/whose                                  rows
        POST   /library/acts/{act}                                        rows
        GET    /recordings/{recording_id}/delete                          recording.read
        POST   /recordings/{recording_id}/delete                          rows
        POST   /recordings/{recording_id}/finish                          rows
        POST   /recordings/{recording_id}/finish/proposal                 rows
        POST   /recordings/{recording_id}/restore                         rows
        POST   /beside/compare/align                                      rows
        POST   /columns/{header}                                          rows
        POST   /columns/{header}/delete                                   rows
    """,
    "release": """
        POST   /analyses/{analysis_id}/conclude                           rows
        POST   /analyses/{analysis_id}/dismiss                            rows
        DELETE /api/v1/analyses/{analysis_id}/conclusion-draft            rows
        POST   /analyses/{analysis_id}/release                            rows
        POST   /api/v1/analyses/{analysis_id}/release                     rows
        DELETE /api/v1/analyses/{analysis_id}/release                     rows
    """,
    "export": """
        GET    /api/v1/recordings/{recording_id}/file                     file.exported
        GET    /api/v1/analyses/{analysis_id}/results.json                file.exported
        GET    /api/v1/analyses/{analysis_id}/elevation.parquet           file.exported
        GET    /api/v1/analyses/{analysis_id}/fhir.json                   file.exported
        GET    /api/v1/analyses/{analysis_id}/datapackage.json            file.exported
        GET    /api/v1/analyses/{analysis_id}/bundle.zip                  file.exported
        GET    /api/v1/analyses/{analysis_id}/hours.csv                   file.exported
        GET    /api/v1/analyses/{analysis_id}/periods.csv                 file.exported
        GET    /api/v1/analyses/{analysis_id}/tasks.csv                   file.exported
        GET    /api/v1/analyses/{analysis_id}/postures.csv                file.exported
        GET    /api/v1/analyses/{analysis_id}/marks.csv                   file.exported
        GET    /api/v1/analyses/{analysis_id}/elevation.csv.gz            file.exported
        GET    /api/v1/analyses/{analysis_id}/summary.csv                 file.exported
        GET    /api/v1/analyses/{analysis_id}/summary_fr.csv              file.exported
        GET    /api/v1/analyses/{analysis_id}/summary.xlsx                file.exported
        GET    /api/v1/analyses/{analysis_id}/summary.parquet             file.exported
        GET    /api/v1/analyses/{analysis_id}/dictionary.csv              file.exported
        GET    /api/v1/analyses/{analysis_id}/redcap_import.csv           file.exported
        GET    /api/v1/analyses/{analysis_id}/redcap_dictionary.csv       file.exported
        GET    /api/v1/batches/{batch_id}/summary.csv                     file.exported again
        GET    /api/v1/batches/{batch_id}/problems.csv                    file.exported again
        GET    /api/v1/validations/{validation_id}/{name}                 file.exported
        GET    /api/v1/compare/comparison.json                            file.exported
        GET    /api/v1/pair/pair.json                                     file.exported
        GET    /api/v1/profile/profile.json                               file.exported again
        GET    /api/v1/profile/{name}.csv                                 file.exported again
        GET    /library/{name}.csv                                        file.exported again
        GET    /library/reports.zip                                       file.exported again
        GET    /library/recordings.zip                                    file.exported again
        POST   /library/acts/reports.zip                                  file.exported again
        POST   /library/acts/{name}.csv                                   file.exported again
        GET    /days/{name}.csv                                           file.exported again
        GET    /api/v1/webhooks                                           list.read
        POST   /api/v1/webhooks                                           rows again
        DELETE /api/v1/webhooks/{webhook_id}                              rows
    """,
    "erase": """
        GET    /recordings/{recording_id}/purge                           recording.read again
        POST   /recordings/{recording_id}/purge                           rows again
        POST   /recordings/{recording_id}/hold                            rows again
        PUT    /api/v1/recordings/{recording_id}/hold                     rows
        DELETE /api/v1/recordings/{recording_id}/hold                     rows again
        PUT    /api/v1/retention/{kind}                                   rows again
        POST   /retention                                                 rows again
    """,
    "aggregate": """
        GET    /aggregate                                                 aggregate.read
        GET    /api/v1/studies/{study_id}/aggregate.json                  aggregate.read
    """,
    "people": """
        GET    /people                                                    people.read again
        POST   /people                                                    rows again
        POST   /people/{person_id}/roles                                  rows again
        POST   /people/{person_id}/link                                   rows again
        POST   /people/{person_id}/end                                    rows again
        POST   /people/{person_id}/resume                                 rows again
    """,
    "trail": """
        GET    /metrics                                                   none
        GET    /trail                                                     trail.read
        GET    /api/v1/trail                                              trail.read
        GET    /api/v1/trail/trail.csv                                    trail.exported
        GET    /api/v1/trail/trail.jsonl                                  trail.exported
    """,
}


@dataclass(frozen=True, slots=True)
class Route:
    """Requirements of a route; ``act``: the act that the response adds to the audit log, None for none."""

    needed: Needed
    act: Act | None
    asks_again: bool


def _read_routes() -> Iterator[tuple[tuple[str, str], Route]]:
    for needed, lines in _ROUTES.items():
        for method, path, act, *marks in filter(None, map(str.split, lines.splitlines())):
            if act not in (*ACTS, "rows", "none") or marks not in ([], ["again"]):
                raise ValueError(f"{method} {path}")
            yield (method, path), Route(needed, cast("Act", act) if act in ACTS else None, bool(marks))


ROUTE_TABLE: Mapping[tuple[str, str], Route] = MappingProxyType(dict(_read_routes()))
"""By method and path, as declared in the route."""
