"""Readers of other packages: found by their metadata; one that fails is named, and stops no other."""

import io
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from acromion.app.analysis.inspect import read_file
from acromion.app.formats import Format, find_added_formats
from acromion.app.request import ReportRequest
from acromion.fusion import plugins
from acromion.fusion.errors import FailedReader, NoGyroscope
from acromion.fusion.readers import read_recording
from acromion.fusion.recording import Recording
from acromion.fusion.simulation import write_recordings

AddReader = Callable[[str, str], None]

WHOLE = """
import numpy as np
from acromion.fusion.recording import Recording, Segment

def recognise(source):
    return source.head.startswith(b"MINE")

def read(source, rate_hz):
    acc_g = np.tile(np.float32([0.0, -1.0, 0.0]), (6000, 1)) + noise(1, 0.005)
    run = Segment(0, 100.0, acc_g, noise(2, 0.5))
    return Recording("my logger", "", None, None, run.duration_us, (run,))

def noise(seed, size):
    return np.random.default_rng(seed).normal(0, size, (6000, 3)).astype(np.float32)
"""


@pytest.fixture
def add_reader(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[AddReader]:
    """Install a reader of one module, version 2.0, as a folder on the path."""
    monkeypatch.syspath_prepend(tmp_path)

    def add(name: str, module: str) -> None:
        (tmp_path / f"{name}.py").write_text(module)
        about = tmp_path / f"{name}-2.0.dist-info"
        about.mkdir()
        (about / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 2.0\n")
        (about / "entry_points.txt").write_text(f"[acromion.readers]\n{name} = {name}\n")
        plugins.find_entry_points.cache_clear()

    yield add
    monkeypatch.undo()
    plugins.find_entry_points.cache_clear()


@pytest.fixture
def table(tmp_path: Path) -> Path:
    return write_recordings(tmp_path / "table", "lsm9ds1", 0.02, 1, 100.0)[0]


def read_mine(content: bytes = b"MINE") -> Recording:
    return read_recording(io.BytesIO(content), file_name="log.mine")


def test_a_plug_in_reads_its_file_under_its_own_device_name(add_reader: AddReader) -> None:
    add_reader("first_reader", WHOLE)

    recording = read_mine()

    assert (recording.device, recording.reader) == ("my logger", ("first_reader", "2.0"))


def test_the_list_of_formats_names_it(add_reader: AddReader) -> None:
    add_reader("first_reader", WHOLE)

    assert find_added_formats() == (Format("first_reader", (), "read by a plug-in, version 2.0"),)


def test_a_reader_of_our_own_is_not_named(add_reader: AddReader, table: Path) -> None:
    add_reader("second_reader", WHOLE)

    assert read_recording(table).reader is None


@pytest.mark.parametrize(
    ("module", "cause"),
    [
        ("import no_such_module", "ModuleNotFoundError: No module named 'no_such_module'"),
        ("def recognise(source): return 1 / 0", "ZeroDivisionError: division by zero"),
        ("", "AttributeError: module 'broken_reader' has no attribute 'recognise'"),
    ],
)
def test_one_that_fails_to_look_at_a_file_stops_no_other_and_is_named(
    add_reader: AddReader, table: Path, module: str, cause: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delitem(sys.modules, "broken_reader", raising=False)
    add_reader("broken_reader", module)
    add_reader(f"whole_reader_{len(cause)}", WHOLE)

    flag = read_recording(table).flags[0]

    assert flag.code == "W-READER"
    assert flag.facts == {"reader": "broken_reader", "version": "2.0", "cause": cause}
    assert read_mine().device == "my logger"


def test_where_nobody_else_knows_the_file_the_one_that_failed_is_the_reason(add_reader: AddReader) -> None:
    add_reader("failing_reader", "import no_such_module")

    with pytest.raises(FailedReader) as caught:
        read_mine()

    assert caught.value.facts["reader"] == "failing_reader"


@pytest.mark.parametrize(
    ("broken", "cause"),
    [
        ("    return rows_of(source)", "NameError: name 'rows_of' is not defined"),
        ("    raise SystemExit('stopped by itself')", "SystemExit: stopped by itself"),
        ("    return [1, 2]", "read gave list, not a Recording"),
        (
            "    a = Segment(0, 1.0, np.ones((9, 3)), 0); return Recording('x', '', None, None, 9, (a,))",
            "acc_g is not float32 of shape (n, 3), all finite",
        ),
        ("    return Recording('x', '', None, None, 0, ())", "no segment, or no duration"),
        (
            "    return Recording('a | b', '', None, None, 0, ())",
            "device is not a plain name of 1 to 60 letters, digits, spaces and any of + - . / ( )",
        ),
    ],
)
def test_one_that_fails_to_read_its_file_refuses_it_by_name(
    add_reader: AddReader, broken: str, cause: str, caplog: pytest.LogCaptureFixture, tmp_path: Path
) -> None:
    name = f"reader_{len(broken)}"
    add_reader(name, WHOLE.replace("    acc_g = ", broken + "\n    acc_g = "))
    path = tmp_path / "log.mine"
    path.write_bytes(b"MINE")

    with pytest.raises(FailedReader) as caught:
        read_file(path, ReportRequest(path.name))

    assert caught.value.facts == {"reader": name, "version": "2.0", "cause": cause}
    assert caplog.messages == [f"the reader plug-in {name} 2.0 failed: {cause}"]
    assert caplog.records[0].exc_info is None


def test_a_log_that_takes_more_gets_the_traceback(
    add_reader: AddReader, caplog: pytest.LogCaptureFixture, tmp_path: Path
) -> None:
    add_reader("traced_reader", WHOLE.replace("    acc_g = ", "    rows_of(source)\n    acc_g = "))
    path = tmp_path / "log.mine"
    path.write_bytes(b"MINE")

    with caplog.at_level("INFO", "acromion"), pytest.raises(FailedReader):
        read_file(path, ReportRequest(path.name))

    assert caplog.records[-1].exc_info


def test_a_refusal_of_ours_that_a_plug_in_raises_stays_what_it_is(add_reader: AddReader) -> None:
    raising = "from acromion.fusion.errors import NoGyroscope\ndef read(source, rate_hz): raise NoGyroscope"
    add_reader("refusing_reader", raising + "\ndef recognise(source): return True")

    with pytest.raises(NoGyroscope):
        read_mine()


def test_a_file_with_a_signature_of_ours_is_read_without_loading_any(
    add_reader: AddReader, shift_gt3x: Path
) -> None:
    add_reader("unloadable_reader", "import no_such_module")

    assert not [flag for flag in read_recording(shift_gt3x).flags if flag.code == "W-READER"]
