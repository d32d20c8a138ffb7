"""Compiled programs, kept in the user's cache folder.

JAX traces a function and compiles it once per process and shape, which takes 10 to 30 seconds for a
network. JAX's own persistent cache saves only the compilation. This module keeps the whole
compiled program, so that the next process neither traces nor compiles.

A kept program is machine code in a pickle (:mod:`jax.experimental.serialize_executable`), and
whoever can write it can run code as the user. Therefore file and folder are used only if they
belong to the user and nobody else can write them. The name of the file is a hash of everything the
program depends on: function, shapes, source code of occjax, JAX, its configuration, and the
machine. A damaged file is replaced without a message.

A program runs on one device, the default device of the thread (``jax.default_device``), and is
compiled for each device, since XLA cannot load it on another one.

If the user has configured JAX's persistent cache (``jax_compilation_cache_dir``), that is used and
nothing is kept here.
"""

from __future__ import annotations

import ctypes
import functools
import hashlib
import os
import pickle
import platform
import stat
import sys
import tempfile
import time
import zlib
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from pathlib import Path
from typing import Any

import jax
import jaxlib
import platformdirs
from jax.experimental import serialize_executable

from occjax.xla import compiler_options, user_settings

MAX_CACHE_BYTES = 200_000_000
"""Size of the cache above which the programs that were not used for longest are removed."""

MAX_LOADED_PROGRAMS = 16
"""Programs of one function that a process keeps in memory for each device, of different shapes."""

SUFFIX = ".program"

TEMPORARY_SUFFIX = ".temporary"

MAX_WRITING_SECONDS = 3600.0
"""Age above which a temporary file is taken for that of a killed process, and removed."""

_WITHOUT_EFFECT = ("cache", "default_device", "dump", "explain", "log", "traceback")
"""Words in the names of options of JAX on which programs do not depend."""

_report: ContextVar[Callable[[], None]] = ContextVar("report", default=lambda: None)

preloaded: dict[Path, Future[Any]] = {}
"""Programs that are being loaded before they are asked for, by their file."""


def kept(function: Callable[..., Any]) -> Callable[..., Any]:
    """Compile a pure function of arrays like ``jax.jit``, and keep its programs.

    Args:
        function: Function of a module of occjax. Positional arguments are arrays or trees of
            arrays, keyword arguments are static and hashable.

    Returns:
        The function, compiled once per shape. It cannot be transformed by JAX.
    """

    @cached_per_device(MAX_LOADED_PROGRAMS)
    def compiled(
        device: jax.Device, structure: Any, shapes: tuple, static: tuple
    ) -> Callable[..., Any]:
        name = (function.__module__, function.__qualname__, static)
        partial = functools.partial(function, **dict(static))
        return load_or_compile(partial, structure, shapes, name, device, quickly=True)

    @functools.wraps(function)
    def call(*arguments: Any, **static: Any) -> Any:
        options = tuple(sorted(static.items()))
        return compiled(current_device(), *signature(arguments), options)(*arguments)

    return call


def signature(arguments: tuple) -> tuple[Any, tuple[jax.ShapeDtypeStruct, ...]]:
    """Return the tree structure of arguments, and the shapes and types of their leaves.

    Args:
        arguments: Arrays or trees of arrays.
    """
    leaves, structure = jax.tree.flatten(arguments)
    return structure, tuple(jax.ShapeDtypeStruct(leaf.shape, leaf.dtype) for leaf in leaves)


def cached_per_device(size: int) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """Return a decorator that keeps the results of the last calls of a function for each device.

    Args:
        size: Number of results for each device, the first argument of the function.

    Example:
        >>> square = cached_per_device(1)(lambda device, number: print("computes") or number**2)
        >>> square("gpu 0", 3), square("gpu 0", 3)
        computes
        (9, 9)
    """

    def decorate(function: Callable[..., Any]) -> Callable[..., Any]:
        @functools.cache
        def on(device: Any) -> Callable[..., Any]:
            return functools.lru_cache(maxsize=size)(functools.partial(function, device))

        return functools.wraps(function)(lambda device, *arguments: on(device)(*arguments))

    return decorate


def current_device() -> jax.Device:
    """Return the device of the programs of this thread.

    Example:
        >>> with jax.default_device(jax.devices()[0]):
        ...     current_device() == jax.devices()[0]
        True
    """
    chosen = jax.config.jax_default_device  # type: ignore[attr-defined]
    return chosen if isinstance(chosen, jax.Device) else jax.local_devices(backend=chosen)[0]


def load_or_compile(
    function: Callable[..., Any],
    structure: Any,
    shapes: tuple[jax.ShapeDtypeStruct, ...],
    name: tuple | None,
    device: jax.Device,
    *,
    quickly: bool = False,
) -> Callable[..., Any]:
    """Return the compiled program of a function, from the cache or by compiling it.

    Args:
        function: Pure function of arrays.
        structure: Tree structure of its arguments.
        shapes: Shapes and types of the leaves of its arguments.
        name: What the function depends on, next to its arguments and the source code of occjax:
            its ``repr`` identifies it. None for a function that is not part of occjax; it is
            traced and identified by the result.
        device: The device on which it runs.
        quickly: Whether to compile in less time. On a CPU, small functions run as fast, networks
            take 1.5 times as long.

    Returns:
        The program, which takes the arguments of the function.
    """
    arguments = jax.tree.unflatten(structure, shapes)

    def lower() -> jax.stages.Lowered:
        with jax.default_device(device):
            return jax.jit(function).lower(*arguments)

    traced = lower() if name is None else None

    def build(path: Path | None) -> Callable[..., Any]:
        _report.get()()
        lowered = traced or lower()
        compiled = _compile(lowered, device, quickly)
        release_memory()
        if path is not None:
            _write(path, compiled)
        return compiled

    folder = _private_folder()
    if folder is None:
        return build(None)
    identity = name if traced is None else (traced.as_text(),)
    path = folder / (_key(identity, structure, shapes, device) + SUFFIX)
    early = preloaded.pop(path, None)
    program = _read(path, device) if early is None else early.result()
    if program is None:
        return build(path)
    with suppress(OSError):  # the time of the last use
        os.utime(path)
    return _replaced_if_broken(program, lambda: build(path))


def _compile(lowered: jax.stages.Lowered, device: jax.Device, quickly: bool) -> jax.stages.Compiled:
    """Compile; quickly without fusion emitters, the code generator of XLA that takes longer."""
    options = {}
    if device.platform == "cpu":
        options = compiler_options() | ({"xla_cpu_use_fusion_emitters": False} if quickly else {})
    try:
        return lowered.compile(compiler_options=options)
    except jax.errors.JaxRuntimeError:
        if not options:
            raise
    return lowered.compile()  # by a version of XLA without one of these options


def preload() -> None:
    """Begin to load the program that was used last, which is likely to be used again.

    It is loaded in a thread of its own, while a light field is read. With several devices nothing
    is loaded, since a program belongs to one of them.
    """
    folder = _private_folder()
    if folder is None or jax.local_device_count() > 1:
        return
    for _, _, path in _entries(folder)[:1]:
        with_one_thread = ThreadPoolExecutor(1)
        preloaded[path] = with_one_thread.submit(_read, path, current_device())
        with_one_thread.shutdown(wait=False)


@contextmanager
def reporting(report: Callable[[], None]) -> Iterator[None]:
    """Call a function before a program is compiled, which takes long, within the block."""
    token = _report.set(report)
    try:
        yield
    finally:
        _report.reset(token)


def cache_folder() -> Path:
    """Return the folder of the kept programs, which may not exist.

    Example:
        >>> cache_folder().name
        'programs'
    """
    return Path(platformdirs.user_cache_dir("occjax")) / "programs"


def cached_programs() -> list[Path]:
    """Return the kept programs, the one that was used last first."""
    return [path for _, _, path in _entries(cache_folder())]


def clear_cache() -> None:
    """Remove all kept programs."""
    for path in cached_programs():
        path.unlink(missing_ok=True)


def _entries(folder: Path) -> list[tuple[int, int, Path]]:
    """Return time of last use, size and path of each program, the last used first."""
    found = []
    for path in folder.glob(f"*{SUFFIX}"):
        try:
            status = path.stat()
        except OSError:  # another process has removed it
            continue
        found.append((status.st_mtime_ns, status.st_size, path))
    return sorted(found, reverse=True)


def _private_folder() -> Path | None:
    """Return the folder of the programs; None if no program can be kept safely."""
    return None if cache_fault() else cache_folder()


def cache_fault() -> str | None:
    """Return why no program is kept or loaded; None if they are. Makes the folder.

    Example:
        >>> before = jax.config.values["jax_compilation_cache_dir"]
        >>> jax.config.update("jax_compilation_cache_dir", "mine")
        >>> cache_fault()
        "JAX's own cache (jax_compilation_cache_dir) is used instead"
        >>> jax.config.update("jax_compilation_cache_dir", before)
    """
    if jax.config.values["jax_compilation_cache_dir"] is not None:
        return "JAX's own cache (jax_compilation_cache_dir) is used instead"
    if not hasattr(os, "geteuid"):
        return "this system does not show who can write to a folder"
    folder = cache_folder()
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        folder.mkdir(mode=0o700, exist_ok=True)
        private = _is_private(folder.lstat(), stat.S_ISDIR)
    except OSError as error:
        return f"it cannot be made ({error.strerror})"
    return None if private else "it must be a folder that only you can write to"


def _is_private(status: os.stat_result, is_kind: Callable[[int], bool]) -> bool:
    """Return whether only the user can write a file or folder of a kind."""
    others_can_write = status.st_mode & (stat.S_IWGRP | stat.S_IWOTH)
    return is_kind(status.st_mode) and status.st_uid == os.geteuid() and not others_can_write


def _read(path: Path, device: jax.Device) -> Any:
    """Return the program in a file; None if there is none that can be used."""
    try:
        # The opened file is checked, since another one could replace it after a check of its path.
        with open(os.open(path, os.O_RDONLY | os.O_NOFOLLOW), "rb") as file:
            if not _is_private(os.fstat(file.fileno()), stat.S_ISREG):
                return None
            data = file.read()
        # Decompression finds damaged files by their checksum.
        serialized, inputs, outputs = pickle.loads(zlib.decompress(data))
        if b"lapack_" in serialized:
            _find_lapack()
        program = serialize_executable.deserialize_and_load(
            serialized, inputs, outputs, execution_devices=[device]
        )
    except Exception:  # whatever is wrong with it, the program can be compiled again
        return None
    return program


@functools.cache
def _find_lapack() -> None:
    """Let JAX find the functions of LAPACK, which it does when it lowers the first of them.

    Until then, a loaded program that calls them ends the process (JAX issue 28908).
    """
    jax.jit(jax.lax.linalg.cholesky).lower(jax.ShapeDtypeStruct((1, 1), "float32"))


def _write(path: Path, program: Any) -> None:
    """Keep a program if it can be kept; remove those that were not used for longest."""
    try:
        data = zlib.compress(pickle.dumps(serialize_executable.serialize(program)), 1)
        with tempfile.NamedTemporaryFile(  # mode 0600
            dir=path.parent, prefix=".", suffix=TEMPORARY_SUFFIX, delete=False
        ) as file:
            file.write(data)
        os.replace(file.name, path)
        for remains in path.parent.glob(f".*{TEMPORARY_SUFFIX}"):
            if time.time() - remains.stat().st_mtime > MAX_WRITING_SECONDS:
                remains.unlink(missing_ok=True)
        total = 0
        for _, size, other in _entries(path.parent):
            total += size
            if total > MAX_CACHE_BYTES:
                other.unlink(missing_ok=True)
    except Exception:  # no space, or a program that cannot be written: it is compiled again
        return


def _replaced_if_broken(
    program: Callable[..., Any], compile_again: Callable[[], Callable[..., Any]]
) -> Callable[..., Any]:
    """Return a program that is compiled again if its first call fails.

    Some versions of XLA load programs in which functions are missing, and find it at the call.
    """
    verified: Callable[..., Any] | None = None

    def call(*arguments: Any) -> Any:
        nonlocal verified
        if verified is None:
            try:
                result = jax.block_until_ready(program(*arguments))
                verified = program
                return result
            except jax.errors.JaxRuntimeError as error:
                if "NOT_FOUND" not in str(error):
                    raise
                verified = compile_again()
        return verified(*arguments)

    return call


def _key(identity: tuple | None, structure: Any, shapes: tuple, device: jax.Device) -> str:
    """Return a hash of everything that a program depends on."""
    settings = [
        (option, repr(value))
        for option, value in sorted(jax.config.values.items())
        if not any(word in option for word in _WITHOUT_EFFECT)
    ]
    # Context managers change options that are not among these values, such as the default type.
    double = jax.dtypes.canonicalize_dtype("float64").name
    target = (device.platform, device.device_kind, device.id)
    parts = (identity, str(structure), shapes, settings, double, target, _environment())
    return hashlib.sha256(repr(parts).encode()).hexdigest()[:40]


@functools.cache
def source_sha256() -> str:
    """Return a hash of the source code of occjax, in hexadecimal digits.

    Example:
        >>> len(source_sha256())
        64
    """
    source = hashlib.sha256()
    for path in sorted(Path(__file__).parent.rglob("*.py")):
        source.update(path.read_bytes())
    return source.hexdigest()


@functools.cache
def _environment() -> tuple:
    """Return what programs depend on that stays the same within a process."""
    device = jax.devices()[0]
    return (
        source_sha256(),
        (jax.__version__, jaxlib.__version__, platform.python_version()),
        (device.platform, device.device_kind, device.client.platform_version, jax.device_count()),
        (platform.machine(), _processor(), os.cpu_count()),
        user_settings(),
    )


def _processor() -> str:
    """Return model and instruction sets of the processor."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError:
        return platform.processor()
    fields = ("model name", "flags", "Features", "CPU part")
    return "\n".join(sorted({line for line in lines if line.startswith(fields)}))


def release_memory() -> None:
    """Return memory that compiler and readers have freed, up to 0.5 GB, to the system.

    The C library of most Linux systems keeps it unless ``malloc_trim`` is called.
    """
    if sys.platform == "linux":
        trim = getattr(ctypes.CDLL(None), "malloc_trim", None)
        if trim is not None:
            trim(0)
