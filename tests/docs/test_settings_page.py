"""The page of settings has every setting of the server."""

from app.settings import Settings
from benchmarks.settings import read_meanings, write_document
from tests import ROOT


def test_every_setting_has_a_meaning() -> None:
    found = [name for names, meaning in read_meanings() for name in names if meaning]

    assert sorted(found) == sorted(Settings.model_fields)


def test_the_page_is_current() -> None:
    page = (ROOT / "docs" / "reference" / "settings.md").read_text("utf-8")

    assert page == write_document(), "run python -m benchmarks.settings > docs/reference/settings.md"
