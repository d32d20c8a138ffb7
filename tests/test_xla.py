"""Settings with which XLA compiles faster, and those of the user."""

import os
import subprocess
import sys

import jax
import pytest

from occjax.xla import WITHOUT_UNROLLING, compiler_options, disable_unrolling

COMPUTE = """
import sys
import numpy as np
from occjax import programs, xla
if sys.argv[1] == "flag":
    xla.disable_unrolling()
def spread(x):
    print("traced")
    return np.float32(2) * x + x.sum()
print(programs.kept(spread)(np.arange(16, dtype=np.float32)).sum())
"""


def test_processes_with_and_without_the_flag_share_programs(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.delenv("JAX_COMPILATION_CACHE_DIR", raising=False)  # then nothing is kept
    for kind, traced in (("flag", "traced\n"), ("none", "")):
        command = [sys.executable, "-c", COMPUTE, kind]
        done = subprocess.run(command, capture_output=True, text=True, check=True)
        assert done.stdout == f"{traced}{2 * 120 + 16 * 120}.0\n"


@pytest.mark.parametrize(
    ("flags", "count"), [("", 1), ("--xla_dump_to=a", 1), ("--xla_backend_optimization_level=0", 0)]
)
def test_the_level_of_the_user_stays_and_xla_knows_the_option(monkeypatch, flags, count):
    monkeypatch.setenv("XLA_FLAGS", flags)
    options = compiler_options()
    assert len(options) == count
    lowered = jax.jit(lambda x: x + 1).lower(jax.ShapeDtypeStruct((3,), "float32"))
    lowered.compile(compiler_options=options)  # raises an error if there is no such option


@pytest.mark.parametrize(
    ("flags", "expected"),
    [
        (None, WITHOUT_UNROLLING),
        ("--xla_dump_to=a", f"--xla_dump_to=a {WITHOUT_UNROLLING}"),
        (WITHOUT_UNROLLING, WITHOUT_UNROLLING),
        ("--xla_backend_extra_options=mine", "--xla_backend_extra_options=mine"),
        ("flags.txt", "flags.txt"),
    ],
)
def test_flags_of_the_user_stay(monkeypatch, flags, expected):
    monkeypatch.delenv("XLA_FLAGS", raising=False)
    if flags is not None:
        monkeypatch.setenv("XLA_FLAGS", flags)
    disable_unrolling()
    assert os.environ["XLA_FLAGS"] == expected
