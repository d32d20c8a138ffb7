import pytest

from occjax.errors import InputError
from occjax.io.atomic import atomic_folder, atomic_path


def names(folder):
    return sorted(entry.relative_to(folder).as_posix() for entry in folder.rglob("*"))


def test_the_file_appears_only_when_it_is_complete(tmp_path):
    path = tmp_path / "new" / "map.pfm"
    with atomic_path(path) as temporary:
        temporary.write_text("whole")
        assert temporary.parent == path.parent
        assert temporary.suffix == ".pfm"
        assert not path.exists()
    assert path.read_text() == "whole"
    assert names(path.parent) == ["map.pfm"]


def test_a_failure_leaves_the_earlier_file_and_no_rest(tmp_path):
    path = tmp_path / "map.pfm"
    path.write_text("earlier")

    def fail_half_way():
        with atomic_path(path) as temporary:
            temporary.write_text("half")
            raise RuntimeError

    with pytest.raises(RuntimeError):
        fail_half_way()
    assert path.read_text() == "earlier"
    assert names(tmp_path) == ["map.pfm"]


def test_a_folder_appears_only_when_it_is_complete(tmp_path):
    path = tmp_path / "new" / "scene"
    with atomic_folder(path) as temporary:
        (temporary / "views").mkdir()
        (temporary / "views" / "a.txt").write_text("a")
        assert not path.exists()
    assert names(tmp_path / "new") == ["scene", "scene/views", "scene/views/a.txt"]


def test_a_failure_leaves_no_folder(tmp_path):
    def fail_half_way():
        with atomic_folder(tmp_path / "scene") as temporary:
            (temporary / "a.txt").write_text("a")
            raise RuntimeError

    with pytest.raises(RuntimeError):
        fail_half_way()
    assert names(tmp_path) == []


def test_an_existing_folder_keeps_the_files_that_were_not_written(tmp_path):
    path = tmp_path / "scene"
    (path / "views").mkdir(parents=True)
    (path / "mine.txt").write_text("mine")
    (path / "views" / "a.txt").write_text("earlier")
    with atomic_folder(path) as temporary:
        (temporary / "views").mkdir()
        (temporary / "views" / "a.txt").write_text("now")
    assert (path / "views" / "a.txt").read_text() == "now"
    assert (path / "mine.txt").read_text() == "mine"
    assert names(tmp_path) == ["scene", "scene/mine.txt", "scene/views", "scene/views/a.txt"]


@pytest.mark.parametrize("writer", [atomic_path, atomic_folder])
def test_a_place_that_cannot_be_written_is_named(tmp_path, writer):
    (tmp_path / "file").write_text("in the way")
    path = tmp_path / "file" / "out"
    with pytest.raises(InputError, match="file/out: cannot be written"), writer(path):
        pass


def test_a_folder_in_the_way_of_a_file_is_named(tmp_path):
    (tmp_path / "map.pfm").mkdir()
    with (
        pytest.raises(InputError, match=r"map\.pfm: cannot be written"),
        atomic_path(tmp_path / "map.pfm") as temporary,
    ):
        temporary.write_text("whole")
    assert names(tmp_path) == ["map.pfm"]


def test_a_file_in_the_way_of_a_folder_is_named_and_kept(tmp_path):
    (tmp_path / "scene").write_text("mine")
    with (
        pytest.raises(InputError, match="scene: cannot be written"),
        atomic_folder(tmp_path / "scene") as temporary,
    ):
        (temporary / "a.txt").write_text("a")
    assert (tmp_path / "scene").read_text() == "mine"
    assert names(tmp_path) == ["scene"]


def test_errors_of_other_files_pass_unchanged(tmp_path):
    with pytest.raises(FileNotFoundError), atomic_path(tmp_path / "map.pfm"):
        (tmp_path / "elsewhere" / "a.txt").read_text()
