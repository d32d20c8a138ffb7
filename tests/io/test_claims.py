import json
from pathlib import Path

import pytest

from occjax.errors import InputError
from occjax.io.claims import claim_folder, first_difference, read_description, write_description

WANTED = {"seed": 1, "sides": (3, 4), "from": Path("pool"), "layers": ({"width": 2}, {"width": 3})}


def claim(folder, may_differ=(), **changes):
    wanted = {**WANTED, **changes}
    return claim_folder(folder, "it.json", wanted, contents="maps", may_differ=may_differ)


def test_the_same_work_goes_on(tmp_path):
    folder = tmp_path / "new" / "folder"
    assert claim(folder) == claim(folder) == read_description(folder / "it.json")
    assert json.loads((folder / "it.json").read_text()) == {
        "seed": 1,
        "sides": [3, 4],
        "from": "pool",
        "layers": [{"width": 2}, {"width": 3}],
    }


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"seed": 2}, "seed is 1, not 2"),
        ({"sides": (3, 5)}, r"sides is \[3, 4\], not \[3, 5\]"),
        ({"layers": ({"width": 2}, {"width": 4})}, r"layers\[1\].width is 3, not 4"),
        ({"more": True}, "more is absent, not True"),
    ],
)
def test_other_work_is_refused_and_the_difference_named(tmp_path, changes, says):
    claim(tmp_path)
    with pytest.raises(InputError, match=f"holds maps with other settings: {says}; choose another"):
        claim(tmp_path, **changes)
    assert read_description(tmp_path / "it.json") == claim(tmp_path)


def test_what_may_differ_stays_as_it_was(tmp_path):
    claim(tmp_path)
    assert claim(tmp_path, ("seed",), seed=2)["seed"] == 1
    with pytest.raises(InputError, match="sides"):
        claim(tmp_path, ("seed",), sides=())


def test_what_is_only_there_is_a_difference_too():
    assert first_difference({"a": 1}, {"a": 1, "b": 2}) == "b is 2, not absent"
    assert first_difference({"a": (1, 2)}, {"a": [1, 2]}) is None


def test_a_folder_of_something_else_is_left_alone(tmp_path):
    (tmp_path / "thesis.tex").write_text("precious")
    with pytest.raises(InputError, match="neither empty nor maps"):
        claim(tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["thesis.tex"]


@pytest.mark.parametrize("text", ["", "{", "3", "[]", "{}"])
def test_a_damaged_description_is_named(tmp_path, text):
    (tmp_path / "it.json").write_text(text)
    with pytest.raises(InputError, match=r"it\.json: is damaged"):
        claim(tmp_path)


def test_a_missing_description_is_named(tmp_path):
    with pytest.raises(InputError, match="no such file"):
        read_description(tmp_path / "it.json")
    write_description(tmp_path / "it.json", WANTED)
    assert read_description(tmp_path / "it.json")["seed"] == 1
