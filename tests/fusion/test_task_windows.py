"""The list of tasks of a validation is read as spreadsheets write it."""

import pytest

from fusion.task_windows import read_tasks


@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"], ids=["unix", "windows", "old mac"])
@pytest.mark.parametrize("delimiter", [",", ";"])
def test_lines_may_end_as_on_any_system(end: str, delimiter: str) -> None:
    rows = ("name,start_s,end_s", "reach,0,10", "carry,10,20")

    tasks = read_tasks("".join(row + end for row in rows).replace(",", delimiter).encode())

    assert [(task.name, task.start_s, task.end_s) for task in tasks] == [
        ("reach", 0.0, 10.0),
        ("carry", 10.0, 20.0),
    ]
