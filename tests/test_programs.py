"""Compiled programs in the user's cache folder: what is kept, and what is never loaded."""

import gc
import os
import pickle
import subprocess
import sys
import weakref
import zlib

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from occjax import programs

ARRAY = np.arange(3.0, dtype=np.float32)


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """The cache folder, with JAX's own cache off as for most users."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    before = jax.config.values["jax_compilation_cache_dir"]
    jax.config.update("jax_compilation_cache_dir", None)
    yield programs.cache_folder()
    jax.config.update("jax_compilation_cache_dir", before)


@pytest.fixture
def one_device(monkeypatch):
    """Programs are loaded early on computers with one device; the tests have several."""
    monkeypatch.setattr(jax, "local_device_count", lambda: 1)


@pytest.fixture
def call():
    """Function that calls ``factor * x`` as in a new process; returns whether it was traced."""

    def call(name=("multiply",), factor=2.0, array=ARRAY):
        traced = []

        def multiply(x):
            traced.append(x)
            return jnp.float32(factor) * x

        leaves, structure = jax.tree.flatten((array,))
        shapes = tuple(jax.ShapeDtypeStruct(leaf.shape, leaf.dtype) for leaf in leaves)
        program = programs.load_or_compile(
            multiply, structure, shapes, name, programs.current_device()
        )
        np.testing.assert_array_equal(program(array), np.float32(factor) * array)
        np.testing.assert_array_equal(program(array), np.float32(factor) * array)
        return bool(traced)

    return call


def test_a_program_is_traced_once_for_each_shape_and_name(folder, call):
    assert call()
    assert not call()
    assert call(array=np.zeros(5, np.float32))
    assert call(name=("multiply", 3), factor=3.0)
    assert len(programs.cached_programs()) == 3
    assert folder.stat().st_mode & 0o777 == 0o700
    assert all(path.stat().st_mode & 0o777 == 0o600 for path in folder.iterdir())
    programs.clear_cache()
    assert programs.cached_programs() == []


def test_small_programs_compile_without_the_option_of_a_version_of_xla(folder, monkeypatch):
    compile_ = jax.stages.Lowered.compile
    options = []

    def compile_without_options(lowered, compiler_options=None):
        options.append(compiler_options)
        if compiler_options:
            raise jax.errors.JaxRuntimeError("INVALID_ARGUMENT: No such compile option")
        return compile_(lowered)

    monkeypatch.setattr(jax.stages.Lowered, "compile", compile_without_options)
    doubled = programs.kept(lambda x: 2.0 * x)
    np.testing.assert_array_equal(doubled(ARRAY), 2.0 * ARRAY)
    assert len(options) == 2


def test_functions_of_others_are_identified_by_what_they_compute(folder, call):
    assert call(name=None, factor=2.0)
    assert call(name=None, factor=3.0)
    assert len(programs.cached_programs()) == 2
    call(name=None, factor=2.0)
    assert len(programs.cached_programs()) == 2


class Malicious:
    """Creates a file when it is read from a pickle."""

    def __init__(self, path):
        self.path = path

    def __reduce__(self):
        return os.mkdir, (str(self.path),)


@pytest.mark.parametrize("damage", ["truncated", "changed", "empty", "another pickle"])
def test_a_damaged_program_is_replaced(folder, call, damage):
    call()
    (path,) = programs.cached_programs()
    data = path.read_bytes()
    changed = bytes([*data[:200], data[200] ^ 1, *data[201:]])
    other = zlib.compress(pickle.dumps("something else"))
    contents = {"truncated": data[:-9], "changed": changed, "empty": b"", "another pickle": other}
    path.write_bytes(contents[damage])
    assert call()
    assert not call()


@pytest.mark.parametrize("way", ["file others can write", "link", "folder others can write"])
def test_what_others_could_have_written_is_never_unpickled(folder, call, tmp_path, way):
    call()
    (path,) = programs.cached_programs()
    data = zlib.compress(pickle.dumps(Malicious(tmp_path / "trace")))
    if way == "link":
        path.unlink()
        (tmp_path / "other").write_bytes(data)
        path.symlink_to(tmp_path / "other")
    else:
        path.write_bytes(data)
        (folder if way.startswith("folder") else path).chmod(0o777)
    assert call()
    assert not (tmp_path / "trace").exists()


def test_the_programs_that_were_not_used_for_longest_are_removed(folder, call, monkeypatch):
    call(name=("first",))
    call(name=("second",))
    first, second = sorted(programs.cached_programs(), key=lambda path: path.stat().st_mtime_ns)
    os.utime(second, (1, 1))
    monkeypatch.setattr(programs, "MAX_CACHE_BYTES", int(2.5 * first.stat().st_size))
    assert not call(name=("first",))
    call(name=("third",))
    assert first in programs.cached_programs()
    assert second not in programs.cached_programs()


def test_the_program_that_was_used_last_is_loaded_early(folder, call, one_device):
    call(name=("first",))
    call(name=("second",))
    assert not call(name=("first",))
    last = programs.cached_programs()[0]
    programs.preload()
    (loading,) = programs.preloaded.values()
    assert loading.result() is not None
    last.chmod(0o666)  # would be refused if it were read again
    assert not call(name=("first",))
    assert call(name=("first",))
    programs.preload()
    assert call(name=("third",))  # another program is the one that is needed
    assert not call(name=("first",))


def test_a_damaged_program_that_is_loaded_early_is_replaced(folder, call, one_device):
    call()
    (path,) = programs.cached_programs()
    path.write_bytes(b"damaged")
    programs.preload()
    assert call()
    assert not call()


def test_a_cache_that_the_user_has_configured_for_jax_is_used_instead(folder, call, tmp_path):
    jax.config.update("jax_compilation_cache_dir", str(tmp_path / "mine"))
    assert call()
    assert not folder.exists()


def test_a_program_that_fails_when_it_is_called_is_compiled_again(folder, call, monkeypatch):
    call()

    def broken(*_, **__):
        def program(*_):
            raise jax.errors.JaxRuntimeError("NOT_FOUND: Function not found")

        return program

    monkeypatch.setattr(programs.serialize_executable, "deserialize_and_load", broken)
    assert call()


SOLVE = """
import jax, jax.numpy as jnp, numpy as np
from occjax import programs
arrays = np.array([[2.0, 1.0], [1.0, 3.0]], np.float32), np.array([5.0, 10.0], np.float32)
structure, shapes = programs.signature(arrays)
solve = programs.load_or_compile(
    jnp.linalg.solve, structure, shapes, ("solve",), programs.current_device()
)
print(solve(*arrays), len(programs.cached_programs()))
"""


@pytest.mark.slow
def test_a_program_that_calls_lapack_runs_in_a_new_process(tmp_path, monkeypatch):
    """JAX finds the functions of LAPACK when it traces; without it, the process would die."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.delenv("JAX_COMPILATION_CACHE_DIR")
    for _ in range(2):
        done = subprocess.run([sys.executable, "-c", SOLVE], capture_output=True, text=True)
        assert (done.returncode, done.stdout) == (0, "[1. 3.] 1\n"), done.stderr


def test_a_folder_that_cannot_be_made_is_no_error(folder, call, tmp_path, monkeypatch):
    (tmp_path / "file").touch()
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
    assert call()
    assert call()


def test_programs_that_were_not_used_for_longest_leave_the_memory():
    class Program:
        pass

    @programs.cached_per_device(2)
    def compiled(device, shape):
        return Program()

    held = [weakref.ref(compiled("cpu 0", shape)) for shape in (1, 2, 3)]
    other = weakref.ref(compiled("cpu 1", 1))
    gc.collect()
    assert [program() is None for program in held] == [True, False, False]
    assert compiled("cpu 0", 3) is held[2]()
    assert compiled("cpu 1", 1) is other()
