"""The columns of unknown tables are named once for all files with the same header."""

import re
import zipfile
from collections.abc import Iterator
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest
from playwright.sync_api import Page, expect

from acromion.fusion.simulation import write_recordings
from tests.pages.conftest import keep_picture
from tests.pages.steps import END_MS, open_analysis, open_home, see_end, wait_for_curve, wait_for_end
from tests.ways_in.servers import RunningServer

COUNT = 3


@pytest.fixture(scope="module")
def lines(tmp_path_factory: pytest.TempPathFactory) -> list[str]:
    """The rows of a simulated recording, without their header."""
    table = write_recordings(tmp_path_factory.mktemp("made"), "lsm9ds1", 0.03, 41, 100.0)[0]
    return [line for line in table.read_text().splitlines() if line[:1].isdigit()]


@pytest.fixture
def server(tmp_path: Path) -> Iterator[RunningServer]:
    """A server of its own: what was named for one test is not there for another."""
    running = RunningServer(tmp_path / "data", tmp_path / "server.log")
    yield running
    running.stop()


def write_table(path: Path, lines: list[str], skipped: int) -> Path:
    names = ",".join(f"c{number}" for number in range(lines[0].count(",") + 1))
    path.write_text("\n".join([names, *lines[skipped:]]))
    return path


def choose_columns(page: Page, time: str = "1") -> None:
    for number, name in enumerate(("acceleration", "angular_rate")):
        for axis, letter in enumerate("xyz"):
            page.locator(f"[name={name}_{letter}]").select_option(str(2 + 3 * number + axis))
    page.locator("[name=time]").select_option(time)


def test_one_answer_serves_all_that_were_dropped_and_those_that_follow(
    page: Page, server: RunningServer, lines: list[str], tmp_path: Path
) -> None:
    tables = [write_table(tmp_path / f"{k}.csv", lines, k) for k in range(COUNT)]
    open_home(page, server)
    page.set_input_files("#files", tables)
    for table in tables:
        wait_for_end(page, table.name, "failed")
    expect(page.get_by_role("search")).to_be_visible()  # the empty page has become the workbench, live
    expect(page.locator("#bar")).to_have_class(re.compile("is-bar"))
    expect(page.locator(".chips a", has_text="No report").locator("b")).to_have_text(str(COUNT))

    page.get_by_role("link", name="Name the columns: 0.csv").click()
    choose_columns(page)
    expect(page.get_by_role("checkbox")).to_be_checked()
    keep_picture(page, "columns")
    page.get_by_role("button", name="Analyse with these columns").click()
    expect(page.get_by_role("heading", name="The answer in short")).to_be_visible(timeout=END_MS)
    wait_for_curve(page)

    open_home(page, server)
    for table in tables:
        wait_for_end(page, table.name)
    later = server.send(write_table(tmp_path / "later.csv", lines, COUNT))
    assert see_end(server, later["id"])["state"] == "succeeded"
    open_analysis(page, server, later["id"])
    page.get_by_text("Settings and origin", exact=True).click()
    expect(page.get_by_text("Acceleration: c1, c2, c3")).to_be_visible()


def test_a_mapping_that_leads_to_a_refusal_leads_back_to_the_columns(
    page: Page, server: RunningServer, lines: list[str], tmp_path: Path
) -> None:
    job = server.send(write_table(tmp_path / "strange.csv", lines, 0))
    see_end(server, job["id"])
    page.goto(f"{server.address}analyses/{job['id']}/columns?lang=en")
    choose_columns(page, time="7")
    page.get_by_role("button", name="Analyse with these columns").click()
    expect(page.get_by_text("No report")).to_be_visible(timeout=END_MS)
    page.get_by_role("link", name="Name the columns again").first.click()

    expect(page.get_by_text("The file was refused with the columns that were named earlier:")).to_be_visible()
    expect(page.locator("[data-problem]")).to_be_visible()
    expect(page.locator("[name=acceleration_x]")).to_have_value("2")


def test_of_two_sensors_in_a_table_the_page_asks_which_one_is_on_the_arm(
    page: Page, server: RunningServer, lines: list[str], tmp_path: Path
) -> None:
    axes = "ax_g,ay_g,az_g,gx_dps,gy_dps,gz_dps"
    header = "sensor,{0},{1}\ntime_us,{2},{2}".format(",".join(6 * ["wrist"]), ",".join(6 * ["arm"]), axes)
    table = tmp_path / "two.csv"
    table.write_text("\n".join([header, *(f"{line},{line.partition(',')[2]}" for line in lines)]))

    failed = server.send(table)
    see_end(server, failed["id"])
    open_analysis(page, server, failed["id"])
    page.get_by_role("link", name="Choose the sensor").click()
    page.get_by_role("radio", name="arm").check()
    keep_picture(page, "sensors")
    page.get_by_role("button", name="Analyse this sensor").click()

    expect(page.get_by_role("heading", name="The answer in short")).to_be_visible(timeout=END_MS)


def test_of_two_devices_in_a_zip_the_page_asks_which_one_is_on_the_arm(
    page: Page, server: RunningServer, lines: list[str], tmp_path: Path
) -> None:
    header = "time_us,ax_g,ay_g,az_g,gx_dps,gy_dps,gz_dps"
    packed = tmp_path / "two.zip"
    with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as archive:
        for name in ("Phone.csv", "WristMotion.csv"):
            archive.writestr(name, "\n".join([header, *lines]))

    failed = server.send(packed)
    see_end(server, failed["id"])
    open_analysis(page, server, failed["id"])
    page.get_by_role("link", name="Choose the sensor").click()
    page.get_by_role("radio", name="WristMotion").check()
    keep_picture(page, "devices")
    page.get_by_role("button", name="Analyse this sensor").click()

    expect(page.get_by_role("heading", name="The answer in short")).to_be_visible(timeout=END_MS)


def test_an_open_order_of_dates_is_answered_in_the_form(
    page: Page, server: RunningServer, lines: list[str], tmp_path: Path
) -> None:
    header = "label,rtcDate,rtcTime,ax_g,ay_g,az_g,gx_dps,gy_dps,gz_dps"
    start = datetime(2026, 3, 2, 7, tzinfo=UTC)
    stamps = (start + timedelta(milliseconds=10 * k) for k in range(len(lines)))
    rows = (
        f"left,{stamp:%m/%d/%Y,%H:%M:%S.%f},{line.partition(',')[2]}"
        for stamp, line in zip(stamps, lines, strict=True)
    )
    table = tmp_path / "dates.csv"
    table.write_text("\n".join([header, *rows]))

    failed = server.send(table)
    see_end(server, failed["id"])
    open_analysis(page, server, failed["id"])
    page.get_by_role("link", name="Name the columns").click()
    expect(page.get_by_role("cell", name="03/02/2026").first).to_be_visible()
    page.locator("[name=date_order]").select_option("mdy")
    keep_picture(page, "dates")
    page.get_by_role("button", name="Analyse with these columns").click()

    expect(page.get_by_role("heading", name="The answer in short")).to_be_visible(timeout=END_MS)


def test_an_open_order_of_dates_in_two_tables_is_answered_in_the_form(
    page: Page, server: RunningServer, lines: list[str], tmp_path: Path
) -> None:
    start = datetime(2026, 3, 2, 7, tzinfo=UTC)
    stamps = [f"{start + timedelta(milliseconds=10 * k):%m/%d/%Y %H:%M:%S.%f}" for k in range(len(lines))]
    fields = [line.split(",")[1:7] for line in lines]
    packed = tmp_path / "two_tables.zip"
    with zipfile.ZipFile(packed, "w") as archive:
        for name, unit, first in (("acc", "g", 0), ("gyro", "deg/s", 3)):
            rows = (
                f"{stamp},{','.join(row[first : first + 3])}"
                for stamp, row in zip(stamps, fields, strict=True)
            )
            header = f"time,x ({unit}),y ({unit}),z ({unit})"
            archive.writestr(f"{name}.csv", "\n".join([header, *rows]))

    failed = server.send(packed)
    see_end(server, failed["id"])
    open_analysis(page, server, failed["id"])
    page.get_by_role("link", name="Name the columns").click()
    expect(page.get_by_role("heading", name="Date format")).to_be_visible()
    expect(page.get_by_role("cell", name="03/02/2026").first).to_be_visible()
    page.locator("[name=date_order]").select_option("mdy")
    keep_picture(page, "dates of two tables")
    page.get_by_role("button", name="Analyse with these columns").click()

    expect(page.get_by_role("heading", name="The answer in short")).to_be_visible(timeout=END_MS)
