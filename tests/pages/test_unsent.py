"""What was typed on the page of a recording and not sent is there again, for the person who typed it."""

from collections.abc import Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Browser, Page, expect

from acromion.app.accounts.accounts import AccountStore
from acromion.app.accounts.passwords import hash_password
from acromion.app.accounts.sign_in import SignIn
from acromion.app.settings import Settings
from acromion.fusion.simulation import write_recordings
from tests.pages.conftest import finish
from tests.pages.steps import END_MS, note_questions, open_analysis, open_home, wait_for_curve
from tests.pages.test_access import PASSWORD, SECRET, log_in
from tests.pages.test_everyone import Look, list_barriers
from tests.ways_in.servers import RunningServer

pytestmark = pytest.mark.browser

TYPED = "Overhead work is the load."
SENT_LATE = "Lower the shelves."
RESTORED = "your unsent entries"


@pytest.fixture(scope="module")
def report_id(server: RunningServer, tmp_path_factory: pytest.TempPathFactory) -> str:
    """A report without a conclusion."""
    file = write_recordings(tmp_path_factory.mktemp("unsent"), "gt9x", 0.02, 71)[0]
    return finish(server, file, subject="S071", side="right")


def leave_and_return(page: Page, server: RunningServer, analysis_id: str) -> None:
    open_home(page, server)
    open_analysis(page, server, analysis_id)
    wait_for_curve(page)


def type_and_wait(page: Page, text: str) -> None:
    """Type a conclusion, and wait until the server has it."""
    with page.expect_response(lambda answer: answer.request.method == "PUT"):
        page.get_by_label("What you conclude").fill(text)


def find_recording(page: Page) -> str:
    """Return the recording of the open page."""
    return str(page.locator("#conclude").get_attribute("data-keep")).removeprefix("conclusion:")


def find_draft(page: Page, server: RunningServer, form: str) -> str | None:
    """Return the text of a draft on the server."""
    answer = page.request.get(f"{server.address}drafts/{form}")
    return answer.json()["text"] if answer.status == 200 else None


def test_a_conclusion_that_was_not_sent_is_there_again(
    page: Page, server: RunningServer, report_id: str
) -> None:
    open_analysis(page, server, report_id)
    page.get_by_label("What you conclude").fill(TYPED)

    leave_and_return(page, server, report_id)

    expect(page.get_by_label("What you conclude")).to_have_value(TYPED)
    expect(page.locator("#conclude [data-unsent]")).to_contain_text(RESTORED)


def test_leaving_the_page_asks_nothing_when_all_is_kept(
    page: Page, server: RunningServer, report_id: str
) -> None:
    asked = note_questions(page)
    open_analysis(page, server, report_id)
    page.get_by_label("What you conclude").fill(TYPED)

    open_home(page, server)

    assert asked == []


def test_what_is_discarded_does_not_come_back(page: Page, server: RunningServer, report_id: str) -> None:
    open_analysis(page, server, report_id)
    page.get_by_label("What you conclude").fill(TYPED)
    leave_and_return(page, server, report_id)

    page.locator("#conclude").get_by_role("button", name="Discard them").click()

    expect(page.get_by_label("What you conclude")).to_have_value("")
    leave_and_return(page, server, report_id)
    expect(page.get_by_label("What you conclude")).to_have_value("")


def test_a_conclusion_that_was_sent_is_kept_no_longer(
    page: Page, server: RunningServer, tmp_path: Path
) -> None:
    report_id = finish(server, write_recordings(tmp_path, "gt9x", 0.02, 72)[0], side="right")
    open_analysis(page, server, report_id)
    page.get_by_label("What you conclude").fill(TYPED)
    page.get_by_label("Your name").fill("M. Tremblay")

    page.get_by_role("button", name="Add to the report").click()

    expect(page.locator(".meta").first).to_contain_text("version 2", timeout=END_MS)
    assert find_draft(page, server, f"conclusion/{find_recording(page)}") is None


def test_a_conclusion_that_the_server_refuses_stays_with_the_reason(
    page: Page, server: RunningServer, report_id: str
) -> None:
    open_analysis(page, server, report_id)
    page.get_by_label("What you conclude").fill(" ")
    page.get_by_label("Your name").fill("M. Tremblay")

    page.get_by_role("button", name="Add to the report").click()

    expect(page.locator("#conclude [data-refused]")).to_contain_text("E-PARAMETER")
    expect(page.get_by_label("Your name")).to_have_value("M. Tremblay")


def test_a_conclusion_that_no_server_takes_stays(page: Page, server: RunningServer, report_id: str) -> None:
    open_analysis(page, server, report_id)
    page.get_by_label("What you conclude").fill(TYPED)
    page.get_by_label("Your name").fill("M. Tremblay")
    page.route("**/conclude", lambda route: route.abort())

    page.get_by_role("button", name="Add to the report").click()

    expect(page.locator("#conclude [data-lost]")).to_be_visible()
    leave_and_return(page, server, report_id)
    expect(page.get_by_label("What you conclude")).to_have_value(TYPED)


def test_a_conclusion_that_was_not_sent_is_on_the_next_version_too(
    page: Page, server: RunningServer, tmp_path: Path
) -> None:
    report_id = finish(server, write_recordings(tmp_path, "gt9x", 0.02, 73)[0], side="right")
    open_analysis(page, server, report_id)
    wait_for_curve(page)
    page.get_by_label("What you conclude").fill(TYPED)

    page.get_by_role("radio", name="left").check()
    page.get_by_role("button", name="Update").click()

    expect(page.get_by_label("What you conclude")).to_have_value(TYPED, timeout=END_MS)


def test_a_correction_that_was_not_sent_is_there_again(
    page: Page, server: RunningServer, report_id: str
) -> None:
    open_analysis(page, server, report_id)
    wait_for_curve(page)
    page.get_by_role("radio", name="left").check()
    page.get_by_label("Reason").fill("the arm was wrong")
    page.locator("#add").click()
    page.locator("#periods [name=label]").fill("shelves")

    leave_and_return(page, server, report_id)

    expect(page.get_by_role("radio", name="left")).to_be_checked()
    expect(page.get_by_label("Reason")).to_have_value("the arm was wrong")
    expect(page.locator("#periods [name=label]")).to_have_value("shelves")
    expect(page.locator("#correction [data-unsent]")).to_contain_text(RESTORED)


def test_a_correction_is_discarded_down_to_the_settings_of_the_analysis(
    page: Page, server: RunningServer, report_id: str
) -> None:
    open_analysis(page, server, report_id)
    wait_for_curve(page)
    page.get_by_role("radio", name="left").check()
    page.locator("#add").click()
    leave_and_return(page, server, report_id)

    page.locator("#correction").get_by_role("button", name="Discard them").click()

    expect(page.get_by_role("radio", name="right")).to_be_checked()
    expect(page.locator("#periods tr")).to_have_count(0)
    leave_and_return(page, server, report_id)
    expect(page.get_by_role("radio", name="right")).to_be_checked()


def correct_in_another_tab(page: Page, server: RunningServer, report_id: str) -> None:
    other = page.context.new_page()
    open_analysis(other, server, report_id)
    wait_for_curve(other)
    other.locator("#subject").fill("S075")
    other.get_by_role("button", name="Update").click()
    expect(other.locator(".meta").first).to_contain_text("version 2", timeout=END_MS)
    other.close()


def test_a_correction_of_an_outdated_version_opens_the_newer_one_as_a_draft(
    page: Page, server: RunningServer, tmp_path: Path
) -> None:
    report_id = finish(server, write_recordings(tmp_path, "gt9x", 0.02, 75)[0], subject="S074", side="right")
    open_analysis(page, server, report_id)
    wait_for_curve(page)
    correct_in_another_tab(page, server, report_id)
    page.get_by_role("radio", name="left").check()

    page.get_by_role("button", name="Update").click()
    refused = page.locator("#refused")
    expect(refused).to_contain_text("This report was updated after you opened it")
    assert list_barriers(page, Look("en", "light", 1280), "#correction") == []
    refused.get_by_role("link", name="Open the newer version with what I typed").click()

    expect(page.locator(".meta").first).to_contain_text("version 2", timeout=END_MS)
    expect(page.locator("#correction [data-unsent]")).to_contain_text(RESTORED)
    expect(page.get_by_role("radio", name="left")).to_be_checked()
    expect(page.locator("#subject")).to_have_value("S075")  # the other tab's change stays


def test_a_conclusion_on_an_outdated_version_opens_the_newer_one_as_a_draft(
    page: Page, server: RunningServer, tmp_path: Path
) -> None:
    report_id = finish(server, write_recordings(tmp_path, "gt9x", 0.02, 76)[0], subject="S074", side="right")
    open_analysis(page, server, report_id)
    wait_for_curve(page)
    correct_in_another_tab(page, server, report_id)
    page.get_by_label("What you conclude").fill(TYPED)
    page.get_by_label("Your name").fill("M. Tremblay")

    page.get_by_role("button", name="Add to the report").click()
    page.locator("#conclude").get_by_role("link", name="Open the newer version with what I typed").click()

    expect(page.locator(".meta").first).to_contain_text("version 2", timeout=END_MS)
    expect(page.get_by_label("What you conclude")).to_have_value(TYPED)


def test_what_an_earlier_release_kept_is_left_aside(
    page: Page, server: RunningServer, report_id: str
) -> None:
    page.request.put(f"{server.address}drafts/correction/{report_id}", data="side=left")

    open_analysis(page, server, report_id)
    wait_for_curve(page)

    expect(page.get_by_role("radio", name="right")).to_be_checked()
    expect(page.locator("#correction [data-unsent]")).to_be_hidden()


def test_a_server_that_keeps_nothing_is_a_reason_to_ask_before_the_page_is_left(
    page: Page, server: RunningServer, report_id: str
) -> None:
    asked = note_questions(page)
    page.route("**/drafts/**", lambda route: route.abort())
    open_analysis(page, server, report_id)
    page.get_by_label("What you conclude").press_sequentially("typed")
    expect(page.locator("#conclude[data-unsaved]")).to_be_attached()

    page.goto(server.address)

    assert asked == ["beforeunload"]


@pytest.mark.parametrize("width", [1440, 1000, 390])
@pytest.mark.parametrize(("language", "label"), [("en", "What you conclude"), ("fr", "Votre conclusion")])
def test_another_browser_shows_what_a_crashed_one_had_typed(
    browser: Browser, server: RunningServer, report_id: str, width: int, language: str, label: str
) -> None:
    typed = f"{language} {width}"
    crashed, other = (browser.new_context(viewport={"width": width, "height": 900}) for _ in range(2))
    page = crashed.new_page()
    page.goto(f"{server.address}analyses/{report_id}?lang={language}")
    with page.expect_response(lambda answer: answer.request.method == "PUT"):
        page.get_by_label(label).fill(typed)
    crashed.close()

    again = other.new_page()
    again.goto(f"{server.address}analyses/{report_id}?lang={language}")

    expect(again.get_by_label(label)).to_have_value(typed)
    expect(again.locator("#conclude [data-unsent]")).to_be_visible()
    other.close()


# With accounts.


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("shared") / "data"


@pytest.fixture(scope="module")
def shared_id(data: Path) -> str:
    """A report from before there were accounts."""
    running = RunningServer(data, data.parent / "before.log")
    made = finish(running, write_recordings(data.parent, "gt9x", 0.02, 74)[0], subject="S074", side="right")
    running.stop()
    return made


@pytest.fixture(scope="module")
def clinic(data: Path, shared_id: str) -> Iterator[RunningServer]:
    """A server on which Anna and Clara sign in, both clinicians."""
    settings = Settings(data_dir=data)
    sign_in = SignIn(AccountStore(settings), settings)
    for login in ("anna", "clara"):
        person = sign_in.accounts.add_person(login, login.title(), ["clinician"])
        sign_in.credentials.set_password(person.id, hash_password(PASSWORD))
    sign_in.accounts.database.close()
    running = RunningServer(data, data.parent / "log", workers=0, ACROMION_NO_SECRET="0")
    yield running
    running.stop()


@pytest.fixture
def unused_codes(data: Path, clinic: RunningServer) -> Iterator[SignIn]:
    """The authenticators of both; none of their codes was used."""
    settings = Settings(data_dir=data)
    sign_in = SignIn(AccountStore(settings), settings)
    renew_codes(sign_in)
    yield sign_in
    sign_in.accounts.database.close()


def renew_codes(sign_in: SignIn) -> None:
    for login in ("anna", "clara"):
        person = sign_in.accounts.find_person(login)
        assert person is not None
        sign_in.credentials.set_second_factor(person.id, SECRET, 0, ["aaaa-bbbb-cccc-dddd-eeee-fff2"])


def test_no_other_person_sees_what_was_typed(
    page: Page, clinic: RunningServer, shared_id: str, unused_codes: SignIn
) -> None:
    log_in(page, clinic, "clara")
    open_analysis(page, clinic, shared_id)
    with page.expect_response(lambda answer: answer.request.method == "PUT" and "/drafts/" in answer.url):
        page.get_by_label("What you conclude").fill(TYPED)
    page.context.clear_cookies()  # the session of Clara has ended, and Anna comes

    log_in(page, clinic, "anna")
    open_analysis(page, clinic, shared_id)
    wait_for_curve(page)
    expect(page.get_by_label("What you conclude")).to_have_value("")

    page.context.clear_cookies()
    renew_codes(unused_codes)
    log_in(page, clinic, "clara")
    open_analysis(page, clinic, shared_id)
    expect(page.get_by_label("What you conclude")).to_have_value(TYPED)


def test_nothing_that_was_typed_stays_in_the_browser(
    page: Page, clinic: RunningServer, shared_id: str, unused_codes: SignIn
) -> None:
    log_in(page, clinic, "clara")
    open_analysis(page, clinic, shared_id)
    type_and_wait(page, TYPED)

    assert TYPED not in str(page.evaluate("JSON.stringify({ ...localStorage, ...sessionStorage })"))


def test_a_conclusion_sent_after_the_session_ended_is_there_after_signing_in(
    page: Page, clinic: RunningServer, shared_id: str, unused_codes: SignIn
) -> None:
    log_in(page, clinic, "clara")
    open_analysis(page, clinic, shared_id)
    type_and_wait(page, SENT_LATE)
    page.context.clear_cookies()

    page.get_by_role("button", name="Add to the report").click()
    expect(page.locator("#conclude [data-refused]")).to_contain_text("E-SIGN-IN")
    renew_codes(unused_codes)
    log_in(page, clinic, "clara")
    open_analysis(page, clinic, shared_id)

    expect(page.get_by_label("What you conclude")).to_have_value(SENT_LATE)
