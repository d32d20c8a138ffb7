"""The command that shows and empties the cache of programs."""

import jax
import pytest

from occjax import programs


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """The folder of the programs, with one file; JAX's own cache is off as for most users."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    before = jax.config.values["jax_compilation_cache_dir"]
    jax.config.update("jax_compilation_cache_dir", None)
    folder = programs.cache_folder()
    folder.mkdir(parents=True, mode=0o700)
    (folder / "one.program").write_bytes(bytes(2_000_000))
    yield folder
    jax.config.update("jax_compilation_cache_dir", before)


def test_programs_are_shown_and_removed(run, folder):
    code, out, _ = run("cache")
    assert (code, out) == (0, f"{folder}: 1 program of 2.0 MB, at most 200 MB\n")
    code, out, _ = run("cache", "clear")
    assert (code, out) == (0, f"{folder}: removed 1 program of 2.0 MB\n")
    assert not list(folder.iterdir())


def test_the_reason_why_no_program_is_kept_is_shown(run, folder):
    folder.chmod(0o777)
    assert run("cache")[1].endswith(
        "; not in use: it must be a folder that only you can write to\n"
    )
    jax.config.update("jax_compilation_cache_dir", "mine")
    assert "not in use: JAX's own cache (jax_compilation_cache_dir) is used" in run("cache")[1]
