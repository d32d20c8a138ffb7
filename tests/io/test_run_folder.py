import json
from pathlib import Path

import pytest

from occjax.errors import InputError
from occjax.io.run_folder import (
    first_difference,
    open_run_folder,
    read_description,
    write_description,
)

SETTINGS = {
    "seed": 1,
    "sides": (3, 4),
    "from": Path("pool"),
    "layers": ({"width": 2}, {"width": 3}),
}


def start(folder, may_differ=(), **changes):
    settings = {**SETTINGS, **changes}
    return open_run_folder(folder, "it.json", settings, contents="maps", may_differ=may_differ)


def test_the_same_settings_reopen_the_folder(tmp_path):
    folder = tmp_path / "new" / "folder"
    assert start(folder) == start(folder) == read_description(folder / "it.json")
    assert json.loads((folder / "it.json").read_text()) == {
        "seed": 1,
        "sides": [3, 4],
        "from": "pool",
        "layers": [{"width": 2}, {"width": 3}],
    }


@pytest.mark.parametrize(
    ("changes", "difference"),
    [
        ({"seed": 2}, "seed is 1, not 2"),
        ({"sides": (3, 5)}, r"sides is \[3, 4\], not \[3, 5\]"),
        ({"layers": ({"width": 2}, {"width": 4})}, r"layers\[1\].width is 3, not 4"),
        ({"more": True}, "more is absent, not True"),
    ],
)
def test_other_settings_are_refused_and_the_difference_is_named(tmp_path, changes, difference):
    start(tmp_path)
    with pytest.raises(InputError, match=f"with other settings: {difference}; choose another"):
        start(tmp_path, **changes)
    assert read_description(tmp_path / "it.json") == start(tmp_path)


def test_settings_that_may_differ_keep_their_stored_value(tmp_path):
    start(tmp_path)
    assert start(tmp_path, ("seed",), seed=2)["seed"] == 1
    with pytest.raises(InputError, match="sides"):
        start(tmp_path, ("seed",), sides=())


def test_a_field_of_only_one_description_is_a_difference():
    assert first_difference({"a": 1}, {"a": 1, "b": 2}) == "b is 2, not absent"
    assert first_difference({"a": (1, 2)}, {"a": [1, 2]}) is None


def test_a_folder_of_other_files_is_left_alone(tmp_path):
    (tmp_path / "thesis.tex").write_text("precious")
    with pytest.raises(InputError, match="neither empty nor maps"):
        start(tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["thesis.tex"]


@pytest.mark.parametrize("text", ["", "{", "3", "[]", "{}"])
def test_a_damaged_description_is_reported(tmp_path, text):
    (tmp_path / "it.json").write_text(text)
    with pytest.raises(InputError, match=r"it\.json: cannot be decoded"):
        start(tmp_path)


def test_a_missing_description_is_reported(tmp_path):
    with pytest.raises(InputError, match="no such file"):
        read_description(tmp_path / "it.json")
    write_description(tmp_path / "it.json", SETTINGS)
    assert read_description(tmp_path / "it.json")["seed"] == 1
