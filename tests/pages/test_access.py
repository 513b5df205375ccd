"""Logging in, one's account and the page of people, as a person uses them."""

import re
import secrets
import time
from collections.abc import Iterator
from pathlib import Path
from typing import cast

import pyotp
import pytest
from playwright.sync_api import BrowserContext, Page, expect
from sqlalchemy import update

from acromion.app.accounts.accounts import AccountStore
from acromion.app.accounts.passwords import hash_password
from acromion.app.accounts.sign_in import SignIn
from acromion.app.accounts.subjects import Role
from acromion.app.library.database.tables import sessions
from acromion.app.library.jobs import JobStore
from acromion.app.report.words.wording import Language, load_wording
from acromion.app.request import ReportRequest
from acromion.app.settings import Settings
from acromion.app.store.folder import StoredRecording
from tests.pages.conftest import keep_picture, open_page
from tests.pages.steps import list_other_times
from tests.pages.test_everyone import LOOKS, SCREENS, Look, list_barriers, show_as
from tests.ways_in.servers import RunningServer

pytestmark = pytest.mark.browser

PASSWORD = "seven green bicycles"
PEOPLE = {"maria": ("Maria Roy", "manager"), "clara": ("Clara Léger", "clinician", "manager")}
SECRET = "JBSWY3DPEHPK3PXPJBSWY3DPEHPK3PXP"


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("access") / "data"
    folder.mkdir()
    return folder


@pytest.fixture(scope="module")
def sign_in(data: Path) -> Iterator[SignIn]:
    """The accounts: Maria manages people, Clara is a clinician and manages them, too."""
    settings = Settings(data_dir=data)
    accounts = AccountStore(settings)
    opened = SignIn(accounts, settings)
    kept = hash_password(PASSWORD)
    for login, (name, *roles) in PEOPLE.items():
        person = accounts.add_person(login, name, cast("list[Role]", roles))
        opened.credentials.set_password(person.id, kept)
    yield opened
    accounts.database.close()


@pytest.fixture(scope="module")
def clinic(data: Path, sign_in: SignIn) -> Iterator[RunningServer]:
    """A server that people log in to."""
    running = RunningServer(data, data.parent / "log", workers=0, ACROMION_NO_SECRET="0")
    yield running
    running.stop()


@pytest.fixture(autouse=True)
def unused_codes(sign_in: SignIn) -> None:
    """Everybody has an authenticator, of which no code was used; the person of Maria sets hers up anew."""
    for login in ("maria", "clara"):
        person = sign_in.accounts.find_person(login)
        assert person is not None
        codes = [f"aaaa-bbbb-cccc-dddd-eeee-fff{n}" for n in range(2, 8)]
        sign_in.credentials.set_second_factor(person.id, SECRET, 0, codes)


def log_in(page: Page, clinic: RunningServer, login: str = "clara", language: str = "en") -> None:
    """Give both steps, in English or French."""
    page.goto(f"{clinic.address}login?lang={language}")
    page.locator("input[name=login]").fill(login)
    page.locator("input[name=password]").fill(PASSWORD)
    page.locator("main button").click()
    page.locator("input[name=code]").fill(pyotp.TOTP(SECRET).at(int(time.time())))
    page.locator("main button").click()
    expect(page.locator(".signed-in")).to_be_visible()


def test_a_stranger_is_led_to_the_login_and_then_to_where_he_wanted(
    page: Page, clinic: RunningServer
) -> None:
    page.goto(f"{clinic.address}trash?lang=en")
    expect(page).to_have_url(re.compile(r"/login\?next=%2Ftrash"))

    page.get_by_label("User name").fill("clara")
    page.get_by_label("Password").fill(PASSWORD)
    page.get_by_role("button", name="Sign in").click()
    page.get_by_label("Code").fill(pyotp.TOTP(SECRET).at(int(time.time())))
    page.get_by_role("button", name="Sign in").click()

    expect(page).to_have_url(re.compile(r"/trash"))
    expect(page.get_by_role("link", name="Clara Léger")).to_be_visible()


def test_a_password_can_be_pasted(page: Page, clinic: RunningServer) -> None:
    page.goto(f"{clinic.address}login?lang=en")
    page.evaluate(
        """text => { const field = document.querySelector("input[name=password]"); field.focus();
        document.execCommand("insertText", false, text); }""",
        PASSWORD,
    )

    expect(page.get_by_label("Password")).to_have_value(PASSWORD)


def test_a_wrong_password_is_told_above_the_form(page: Page, clinic: RunningServer) -> None:
    page.goto(f"{clinic.address}login?lang=en")
    page.get_by_label("User name").fill("nobody")
    page.get_by_label("Password").fill("nine blue bicycles")
    page.get_by_role("button", name="Sign in").click()

    expect(page.get_by_role("alert")).to_contain_text("Sign-in failed")


def test_who_has_no_authenticator_sets_one_up_on_the_way_in(
    page: Page, clinic: RunningServer, sign_in: SignIn
) -> None:
    person = sign_in.accounts.find_person("maria")
    assert person is not None
    sign_in.drop_second_factor(person.id)
    page.goto(f"{clinic.address}login?lang=en")
    page.get_by_label("User name").fill("maria")
    page.get_by_label("Password").fill(PASSWORD)
    page.get_by_role("button", name="Sign in").click()

    drawn = page.locator("img.qr")
    expect(drawn).to_be_visible()
    assert drawn.evaluate("image => image.complete && image.naturalWidth > 0")
    keep_picture(page, "access-enrol-en")
    secret = page.locator("code.secret").inner_text()
    page.get_by_label("The six digits").fill(pyotp.TOTP(secret).at(int(time.time())))
    page.get_by_role("button", name="Turn on").click()
    expect(page.get_by_role("heading", name="Save these codes")).to_be_visible()
    keep_picture(page, "access-codes-en")
    assert page.locator(".plain-codes li").count() == 10
    page.get_by_role("link", name="I have saved them").click()

    expect(page.get_by_role("heading", name="People")).to_be_visible()


def test_a_person_is_invited_chooses_a_password_and_is_ended(
    page: Page, other_browser: BrowserContext, clinic: RunningServer
) -> None:
    log_in(page, clinic, "maria")
    page.goto(f"{clinic.address}people?lang=en")
    page.get_by_label("Name", exact=True).fill("Dora Tremblay")
    page.get_by_label("User name").fill("dora")
    page.locator("form[action$='/people'] input[value=clinician]").check()
    page.get_by_role("button", name="Create link").click()
    link = page.locator("code.secret").inner_text()
    keep_picture(page, "access-invited-en")

    with open_page(other_browser) as other:
        other.goto(link)
        other.get_by_label("New password").fill("five yellow umbrellas")
        other.get_by_role("button", name="Save").click()
        expect(other.get_by_role("heading", name="Sign in")).to_be_visible()
        page.get_by_role("button", name="End access: Dora Tremblay").click()
        other.get_by_label("User name").fill("dora")
        other.get_by_label("Password").fill("five yellow umbrellas")
        other.get_by_role("button", name="Sign in").click()
        expect(other.get_by_role("alert")).to_be_visible()

    expect(page.get_by_role("button", name="Restore access: Dora Tremblay")).to_be_visible()


def test_a_token_is_shown_once_on_the_page(page: Page, clinic: RunningServer) -> None:
    log_in(page, clinic)
    page.goto(f"{clinic.address}account?lang=en")
    page.locator("summary", has_text="For scripts").click()
    page.get_by_label("Purpose").fill("nightly")
    page.get_by_label("upload recordings").check()
    page.get_by_role("button", name="Create a token").click()
    expect(page.locator("code.secret")).to_have_text(re.compile(r"^acr_[\w-]{43}$"))
    keep_picture(page, "access-token-en")

    page.goto(f"{clinic.address}account")

    expect(page.locator("code.secret")).to_have_count(0)
    page.locator("summary", has_text="For scripts").click()
    expect(page.get_by_role("button", name="Revoke: nightly")).to_be_visible()


@pytest.mark.parametrize(("width", "language"), SCREENS)
def test_a_saved_password_is_told_and_codes_are_copied_and_printed(
    page: Page, clinic: RunningServer, sign_in: SignIn, width: int, language: Language
) -> None:
    words, look = load_wording(language, "access"), Look(language, "light", width)
    show_as(page, look)
    page.context.grant_permissions(["clipboard-read", "clipboard-write"])
    person = sign_in.accounts.find_person("clara")
    assert person is not None

    page.goto(f"{clinic.address}login/link/{sign_in.make_link(person.id, 60)}?lang={language}")
    page.locator("input[name=password]").fill(PASSWORD)
    page.locator("main button").click()
    expect(page.get_by_role("status")).to_have_text(words["password_saved"])
    keep_picture(page, f"access-saved-{width}-{language}")
    barriers = list_barriers(page, look)
    log_in(page, clinic, language=language)

    expect(page.locator("[name=permission]").first).to_be_hidden()
    page.locator("summary", has_text=words["for_scripts"]).click()
    expect(page.locator("[name=permission]").first).to_be_visible()
    keep_picture(page, f"access-scripts-{width}-{language}")
    page.locator("form[action$='/account/second-factor'] button").click()
    page.locator("input[name=code]").fill(pyotp.TOTP(page.locator("code.secret").inner_text()).now())
    page.locator("main button").click()
    page.get_by_role("button", name=words["codes_copy"]).click()
    expect(
        page.get_by_role("button", name=load_wording(language, "page")["action"]["copied"])
    ).to_be_visible()
    copied = page.evaluate("navigator.clipboard.readText()").split()
    keep_picture(page, f"access-codes-{width}-{language}")
    barriers += list_barriers(page, look)
    page.evaluate("window.print = () => (window.isPrinted = true)")
    page.locator("[data-print]").click()

    assert copied == page.locator(".plain-codes code").all_inner_texts()
    assert page.evaluate("isPrinted")
    assert page.evaluate("document.documentElement.scrollWidth") <= width
    assert barriers == []


@pytest.mark.parametrize("name", ["summary.csv", "reports.zip", "recordings.zip"])
def test_whoever_takes_many_recordings_out_is_asked_for_the_password_again(
    page: Page, clinic: RunningServer, sign_in: SignIn, data: Path, name: str
) -> None:
    log_in(page, clinic)
    add_row(data)
    page.goto(f"{clinic.address}?lang=en")
    make_session_old(sign_in)

    page.locator(f".take a[href*='{name}']").click()
    expect(page.get_by_role("heading", name="Confirm that it is you")).to_be_visible()
    page.get_by_label("Password or code").fill(PASSWORD)
    with page.expect_download() as download:
        page.get_by_role("button", name="Continue").click()

    assert download.value.suggested_filename == name


def add_row(data: Path) -> None:
    """Add a recording that waits."""
    store = JobStore(Settings(data_dir=data))
    stored = StoredRecording(f"rec_{secrets.token_hex(8)}", secrets.token_hex(32), 1)
    store.add(stored, ReportRequest("shift.gt3x"))
    store.close()


def make_session_old(sign_in: SignIn) -> None:
    """Have every session be confirmed long ago."""
    with sign_in.accounts.database.write() as connection:
        connection.execute(update(sessions).values(confirmed_s=0.0))


def test_logging_out_leads_to_the_login_and_nothing_opens_any_more(page: Page, clinic: RunningServer) -> None:
    log_in(page, clinic)

    page.get_by_role("button", name="Sign out").click()
    page.goto(clinic.address)

    expect(page).to_have_url(re.compile("/login"))


def test_the_list_leads_to_the_login_when_the_session_has_ended(
    page: Page, clinic: RunningServer, sign_in: SignIn
) -> None:
    log_in(page, clinic)
    page.goto(clinic.address)
    person = sign_in.accounts.find_person("clara")
    assert person is not None

    sign_in.accounts.end_sessions(person.id)

    expect(page).to_have_url(re.compile("/login"))


def test_the_menu_is_opened_by_the_keyboard_and_leads_to_the_terms(page: Page, clinic: RunningServer) -> None:
    log_in(page, clinic)
    page.locator(".more > summary").focus()

    page.keyboard.press("Enter")
    page.keyboard.press("Tab")
    page.keyboard.press("Tab")
    page.keyboard.press("Enter")

    expect(page.get_by_role("heading", name="How long data is kept")).to_be_visible()


def submit(page: Page, button: str) -> None:
    """Press a button and wait until the page that answers is there."""
    with page.expect_navigation():
        page.locator(button).click()


@pytest.mark.parametrize("look", LOOKS)
def test_the_pages_of_the_accounts_fit_and_have_no_barrier(
    page: Page, clinic: RunningServer, sign_in: SignIn, look: Look
) -> None:
    show_as(page, look)
    found: dict[str, list[str]] = {}
    person = sign_in.accounts.find_person("clara")
    assert person is not None

    def look_at(name: str, part: str | None = None) -> None:
        keep_picture(page, f"access-{name}-{look.language}-{look.scheme}-{look.width}")
        found[name] = list_barriers(page, look, part)
        if page.evaluate("document.documentElement.scrollWidth") > look.width:
            found[name].append("wider than the screen")
        found[name] += list_other_times(page, look.language)

    page.goto(f"{clinic.address}login?lang={look.language}")
    look_at("login")
    page.locator("input[name=login]").fill("clara")
    page.locator("input[name=password]").fill("wrong wrong wrong")
    submit(page, "main button")
    look_at("wrong")
    page.goto(f"{clinic.address}login/link/{sign_in.make_link(person.id, 60)}")
    look_at("new-password")
    log_in(page, clinic, language=look.language)
    page.locator(".more > summary").click()
    look_at("menu", ".more")  # the open menu covers links of the list by half
    for name in ("account", "people", "confirm", "retention", "aggregate"):
        page.goto(f"{clinic.address}{name}")
        look_at(name)
    page.goto(f"{clinic.address}account")
    submit(page, "form[action$='/account/second-factor'] button")
    look_at("enrol")

    assert {name: problems for name, problems in found.items() if problems} == {}


@pytest.mark.parametrize("look", LOOKS)
def test_what_is_told_of_a_link_fits_has_no_barrier_and_leads_on(
    page: Page, clinic: RunningServer, sign_in: SignIn, look: Look
) -> None:
    show_as(page, look)
    person = sign_in.accounts.find_person("clara")
    assert person is not None
    sign_in.set_password_by_link(sign_in.make_link(person.id, 60), PASSWORD, "192.0.2.1")

    log_in(page, clinic, language=look.language)
    expect(page.locator("[role=status]")).to_contain_text("192.0.2.1")
    keep_picture(page, f"access-told-{look.language}-{look.scheme}-{look.width}")
    barriers = list_barriers(page, look)
    width = page.evaluate("document.documentElement.scrollWidth")
    submit(page, "form[action$='/account/told'] button")

    expect(page).to_have_url(clinic.address)
    assert barriers == []
    assert width <= look.width
