"""Sign-in through an identity provider: OpenID Connect, authorization code with PKCE.

Needs the extra ``trust``. A person is identified by issuer and subject, never by an e-mail address. Roles
come from a claim of the ID token at every sign-in; a person without a role is disabled. The access token is
discarded.
"""

import hmac
import logging
import secrets
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any
from urllib.parse import urlsplit

import requests
from authlib.common.errors import AuthlibBaseError
from authlib.integrations.requests_client import OAuth2Session
from joserfc import jwt
from joserfc.errors import JoseError
from joserfc.jwk import KeySet

from acromion.app.accounts.accounts import AccountStore, Person
from acromion.app.accounts.sign_in import TicketStore
from acromion.app.accounts.subjects import ROLES
from acromion.app.errors import NotPermitted, ProviderRefused, TicketSpent
from acromion.app.settings import Settings

TERM_S = 10 * 60.0
TIMEOUT_S = 10.0
LEEWAY_S = 60
LONGEST_NAME = 200
SCOPE = "openid profile"
SIGNED_BY = ("RS256", "PS256", "ES256", "ES384", "EdDSA")
"""Not ``none`` or signatures with the client secret: they do not prove who the provider is."""
_CONFIGURATION = "/.well-known/openid-configuration"
_LOOPBACK = ("127.0.0.1", "localhost", "::1")

logger = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class Return:
    """The person from the provider, the target page, and the session to confirm ("" for a sign-in)."""

    person: Person
    wanted: str
    confirms: str


class Provider:
    """The identity provider of the settings."""

    def __init__(self, accounts: AccountStore, settings: Settings) -> None:
        self._accounts, self._settings = accounts, settings
        self._tickets = TicketStore(accounts.database, accounts.clock)
        self._issuer = settings.oidc_issuer

    def begin(self, back: str, wanted: str, confirms: str = "") -> tuple[str, str]:
        """Return the provider's address for the browser, and the state that the browser must return.

        Raises ProviderRefused.
        """
        nonce, verifier = secrets.token_urlsafe(32), secrets.token_urlsafe(48)
        data = {"nonce": nonce, "verifier": verifier, "wanted": wanted, "confirms": confirms}
        state = self._tickets.make("provider", TERM_S, **data)
        again = {"prompt": "login", "max_age": "0"} if confirms else {}
        with _translate_refusals(), self._open(back) as client:
            place = self._read_configuration()["authorization_endpoint"]
            address, _ = client.create_authorization_url(
                place, state=state, code_verifier=verifier, nonce=nonce, **again
            )
        return str(address), state

    def finish(self, answer: Mapping[str, str], state: str, back: str) -> Return:
        """Check the response of the provider and return its person; ``state`` is this browser's.

        Raises
        ------
        ProviderRefused, NotPermitted
            The provider lists no role.
        """
        given = answer.get("state", "")
        try:
            data = self._tickets.take("provider", given).data
        except TicketSpent:
            raise ProviderRefused(said="state") from None
        if not hmac.compare_digest(given.encode(), state.encode()):
            raise ProviderRefused(said="state")
        if answer.get("iss", self._issuer) != self._issuer or not answer.get("code"):
            raise ProviderRefused(said="answer")
        claims = self._read_claims(answer["code"], back, data)
        return Return(self._find_person(claims), data["wanted"], data["confirms"])

    def _read_claims(self, code: str, back: str, data: Mapping[str, Any]) -> Mapping[str, Any]:
        """Exchange the code for an ID token and check its claims."""
        with _translate_refusals(), self._open(back) as client:
            about = self._read_configuration()
            token = client.fetch_token(about["token_endpoint"], code=code, code_verifier=data["verifier"])
            keys = KeySet.import_key_set(_read_json(_check_place(about["jwks_uri"])))
            claims = jwt.decode(str(token["id_token"]), keys, algorithms=list(SIGNED_BY)).claims
            registry = jwt.JWTClaimsRegistry(
                now=int(self._accounts.clock()),
                leeway=LEEWAY_S,
                iss={"essential": True, "value": self._issuer},
                sub={"essential": True},
                aud={"essential": True, "value": self._settings.oidc_client_id},
                exp={"essential": True},
                iat={"essential": True},
                nonce={"essential": True, "value": data["nonce"]},
            )
            registry.validate(claims)
        ours = self._settings.oidc_client_id
        several = isinstance(claims["aud"], list) and len(claims["aud"]) > 1
        if claims.get("azp", "" if several else ours) != ours:
            raise ProviderRefused(said="audience")
        age_s = self._accounts.clock() - float(claims.get("auth_time") or 0)
        if data["confirms"] and age_s > LEEWAY_S:  # the person must have signed in again
            raise ProviderRefused(said="stale")
        return claims

    def _find_person(self, claims: Mapping[str, Any]) -> Person:
        """Find or create the person of the claims and update the roles."""
        claim, subject = claims.get(self._settings.oidc_claim), str(claims["sub"])
        values = {str(value) for value in (claim if isinstance(claim, list) else [claim])}
        pairs = (pair.strip().partition("=") for pair in self._settings.oidc_roles.split(","))
        named = {value: role for value, sign, role in pairs if sign}
        meant = {named.get(value) for value in values} if named else values
        roles = frozenset(role for role in ROLES if role in meant)
        person = self._accounts.find_person_of(self._issuer, subject)
        if not roles and person is not None and person.ended_at is None:
            logger.warning("the provider lists no role any more: %s is disabled", person.id)
            self._accounts.end_person(person.id)
        if not roles or (person is not None and person.ended_at is not None):
            raise NotPermitted(permission="enter")
        names = (claims.get(key) for key in ("name", "preferred_username"))
        name = str(next(filter(None, names), subject))[:LONGEST_NAME]
        if person is None:
            login = f"{subject}@{urlsplit(self._issuer).netloc}#"  # no typed sign-in name ends like this
            about = Person("", login, name, roles, "", None, self._issuer, False, False)  # noqa: FBT003
            return self._accounts.add_person_of(self._issuer, subject, about)
        self._accounts.set_roles(person.id, roles)
        self._accounts.set_name(person.id, name)
        return self._accounts.get_person(person.id)

    def _open(self, back: str) -> Any:
        settings = self._settings
        client = OAuth2Session(
            settings.oidc_client_id,
            settings.oidc_client_secret,
            scope=SCOPE,
            redirect_uri=back,
            code_challenge_method="S256",
            default_timeout=TIMEOUT_S,
        )
        client.max_redirects = 0
        return client

    def _read_configuration(self) -> Mapping[str, Any]:
        about: Mapping[str, Any] = _read_json(_check_place(self._issuer.rstrip("/") + _CONFIGURATION))
        if about.get("issuer") != self._issuer:
            raise ProviderRefused(said="issuer")
        for name in ("authorization_endpoint", "token_endpoint", "jwks_uri"):
            _check_place(str(about.get(name, "")))
        return about


@contextmanager
def _translate_refusals() -> Iterator[None]:
    """Turn every error in the provider's responses into one refusal; the log contains no value."""
    try:
        yield
    except requests.RequestException as error:
        logger.warning("the identity provider does not answer: %s", type(error).__name__)
        raise ProviderRefused(said="away") from error
    except (JoseError, AuthlibBaseError, ValueError, KeyError) as error:
        wrong = (type(error).__name__, getattr(error, "error", ""), getattr(error, "claim", ""))  # no value
        logger.warning(
            "the response of the identity provider is not valid: %s", " ".join(map(str, wrong)).strip()
        )
        raise ProviderRefused(said="token") from error


def _check_place(address: str) -> str:
    """Check that the connection cannot be intercepted: HTTPS, or this computer."""
    parts = urlsplit(address)
    if parts.scheme != "https" and not (parts.scheme == "http" and parts.hostname in _LOOPBACK):
        raise ProviderRefused(said="issuer")
    return address


def _read_json(address: str) -> Any:
    answer = requests.get(address, timeout=TIMEOUT_S, allow_redirects=False)
    answer.raise_for_status()
    return answer.json()
