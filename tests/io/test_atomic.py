import errno
import os
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor

import pytest

from occjax.errors import InputError
from occjax.io.atomic import atomic_folder, atomic_path, check_writable, remove_leftovers


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


def test_a_failure_leaves_the_earlier_file_and_no_other(tmp_path):
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
def test_a_path_that_cannot_be_written_is_reported(tmp_path, writer):
    (tmp_path / "file").write_text("in the way")
    path = tmp_path / "file" / "out"
    with pytest.raises(InputError, match="file/out: cannot be written"), writer(path):
        pass


def test_a_folder_with_the_name_of_the_file_is_reported(tmp_path):
    (tmp_path / "map.pfm").mkdir()
    with (
        pytest.raises(InputError, match=r"map\.pfm: cannot be written"),
        atomic_path(tmp_path / "map.pfm") as temporary,
    ):
        temporary.write_text("whole")
    assert names(tmp_path) == ["map.pfm"]


def test_a_file_with_the_name_of_the_folder_is_reported_and_kept(tmp_path):
    (tmp_path / "scene").write_text("mine")
    with (
        pytest.raises(InputError, match="scene: cannot be written"),
        atomic_folder(tmp_path / "scene") as temporary,
    ):
        (temporary / "a.txt").write_text("a")
    assert (tmp_path / "scene").read_text() == "mine"
    assert names(tmp_path) == ["scene"]


def test_errors_about_other_files_are_not_changed(tmp_path):
    with pytest.raises(FileNotFoundError), atomic_path(tmp_path / "map.pfm"):
        (tmp_path / "elsewhere" / "a.txt").read_text()


def test_only_owned_files_that_are_not_written_again_are_removed(tmp_path):
    path = tmp_path / "scene"
    path.mkdir()
    for name in ("error.png", "depth.npy", "mine.txt"):
        (path / name).write_text("earlier")
    (path / "points.ply").mkdir()  # a folder: an earlier run did not write it
    with atomic_folder(path, owned=("depth.npy", "error.png", "points.ply", "none")) as temporary:
        (temporary / "depth.npy").write_text("now")
        assert (path / "error.png").exists()
    assert names(path) == ["depth.npy", "mine.txt", "points.ply"]
    assert (path / "depth.npy").read_text() == "now"


@pytest.mark.parametrize("taken_by_a_folder", [True, False])
def test_a_name_conflict_is_found_before_anything_is_replaced(tmp_path, taken_by_a_folder):
    path = tmp_path / "scene"
    path.mkdir()
    (path / "a.txt").write_text("earlier")
    (path / "stale.txt").write_text("earlier")
    (path / "z").mkdir() if taken_by_a_folder else (path / "z").write_text("mine")

    def write():
        with atomic_folder(path, owned=("stale.txt",)) as temporary:
            (temporary / "a.txt").write_text("now")
            (temporary / "z").write_text("now") if taken_by_a_folder else (temporary / "z").mkdir()

    with pytest.raises(InputError, match="scene/z: cannot be written"):
        write()
    assert (path / "a.txt").read_text() == "earlier"
    assert names(tmp_path) == ["scene", "scene/a.txt", "scene/stale.txt", "scene/z"]


@pytest.mark.parametrize("present", [True, False])
def test_a_full_disk_is_reported_with_the_final_path(tmp_path, present):
    path = tmp_path / "scene"
    if present:
        path.mkdir()

    def fill_the_disk():
        with atomic_folder(path) as folder, atomic_path(folder / "map.png"):
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    with pytest.raises(InputError) as caught:
        fill_the_disk()
    final = path / "map.png"
    assert str(caught.value).startswith(f"{final}: cannot be written (no space left on device)")
    assert names(tmp_path) == (["scene"] if present else [])


def test_the_temporary_folder_is_inside_an_existing_folder(tmp_path):
    # It may be the root of a file system, and files cannot be renamed across file systems.
    with atomic_folder(tmp_path) as temporary:
        assert temporary.parent == tmp_path


def test_several_checks_of_one_missing_folder_do_not_disturb_each_other(tmp_path):
    with ThreadPoolExecutor(4) as pool:
        checks = pool.map(lambda _: check_writable(tmp_path / "results" / "today"), range(2000))
        assert list(checks) == [None] * 2000  # an error would be raised here


def test_the_current_folder_can_be_written(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    check_writable(".")
    with atomic_folder(".") as temporary:
        (temporary / "a.txt").write_text("a")
    assert names(tmp_path) == ["a.txt"]


@pytest.mark.parametrize("folder", ["", "there", "new", "there/new/newer"])
def test_checking_a_writable_folder_leaves_no_trace(tmp_path, folder):
    (tmp_path / "there").mkdir()
    check_writable(tmp_path / folder)
    assert names(tmp_path) == ["there"]


@pytest.mark.parametrize("folder", ["file", "file/out", "file/out/scene", "new/" + "long" * 100])
def test_checking_an_impossible_folder_reports_it_and_leaves_no_trace(tmp_path, folder):
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(InputError) as caught:
        check_writable(tmp_path / folder)
    assert str(caught.value).startswith(f"{tmp_path / folder}: cannot be written (")
    assert "\n" not in str(caught.value)
    assert names(tmp_path) == ["file"]


def test_checking_a_read_only_folder_reports_it(tmp_path):
    closed = tmp_path / "closed"
    closed.mkdir(mode=0o500)
    if os.access(closed, os.W_OK):
        pytest.skip("this user may write everywhere")
    for folder in (closed, closed / "out"):
        with pytest.raises(InputError, match="permission denied"):
            check_writable(folder)


def write_and_be_killed(folder):
    """Let another process begin three files and a folder in a folder, and end at once."""
    code = """
import os, sys
from contextlib import ExitStack
from occjax.io.atomic import atomic_folder, atomic_path
folder = sys.argv[1]
with ExitStack() as stack:
    for name in "abc":
        stack.enter_context(atomic_path(f"{folder}/{name}.txt")).write_text("half")
    (stack.enter_context(atomic_folder(f"{folder}/scene")) / "map.pfm").write_text("half")
    os._exit(1)
"""
    subprocess.run([sys.executable, "-c", code, str(folder)], check=False)


def test_files_that_a_killed_process_left_are_removed(tmp_path):
    (tmp_path / ".hidden.txt").write_text("of the user")
    write_and_be_killed(tmp_path)
    assert len(names(tmp_path)) == 6
    with atomic_path(tmp_path / "d.txt") as temporary:
        temporary.write_text("of a running process")
        assert len(remove_leftovers(tmp_path)) == 4
    assert names(tmp_path) == [".hidden.txt", "d.txt"]


def test_a_file_that_cannot_be_deleted_does_not_keep_the_others(tmp_path, monkeypatch):
    write_and_be_killed(tmp_path)
    kept, *others = [entry.path for entry in os.scandir(tmp_path) if entry.is_file()]
    delete = os.unlink

    def refuse_one(path, **options):
        if path == kept:
            raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), path)
        delete(path, **options)

    monkeypatch.setattr("os.unlink", refuse_one)
    removed = remove_leftovers(tmp_path)
    assert {str(path) for path in removed} >= set(others)
    assert names(tmp_path) == [os.path.basename(kept)]
