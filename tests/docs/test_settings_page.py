"""The page of settings has every setting of the server."""

from acromion.app.settings import Settings
from benchmarks.settings import read_meanings


def test_every_setting_has_a_meaning() -> None:
    found = [name for names, meaning in read_meanings() for name in names if meaning]

    assert sorted(found) == sorted(Settings.model_fields)
