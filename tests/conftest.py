"""Strict JAX for every test, and the one table of tolerances."""

import os
import sys

# Most of the time goes into compilation: machine code of the same programs, not optimised, takes
# half of it for the light network.
os.environ.setdefault(
    "XLA_FLAGS", "--xla_force_host_platform_device_count=2 --xla_backend_optimization_level=0"
)
os.environ.setdefault("JAX_PLATFORMS", "cpu")
os.environ.setdefault("MPLBACKEND", "Agg")

from pathlib import Path

import jax
import jax.numpy as jnp
import jaxtyping
import pytest
from jax.experimental.compilation_cache import compilation_cache

jax.config.update("jax_numpy_dtype_promotion", "strict")
jax.config.update("jax_numpy_rank_promotion", "raise")

TOLERANCE = {
    "float64": {"rtol": 1e-10, "atol": 1e-10},
    "float32": {"rtol": 1e-5, "atol": 1e-5},
    "bfloat16": {"rtol": 3e-2, "atol": 3e-2},
}


@pytest.fixture
def tolerance():
    """Keyword arguments of ``np.testing.assert_allclose`` for a dtype."""
    return lambda dtype: TOLERANCE[jnp.dtype(dtype).name]


@pytest.fixture
def x64():
    """Double precision for one test."""
    with jax.enable_x64(True):
        yield


@pytest.fixture
def unchecked():
    """As for users, who have no run-time check of annotations."""
    jaxtyping.config.update("jaxtyping_disable", True)
    yield
    jaxtyping.config.update("jaxtyping_disable", False)


@pytest.fixture(params=["cpu", "elsewhere"])
def platform(request, monkeypatch):
    """The programs of a CPU, and those of other platforms, which a CPU can run as well.

    What is jitted within the test is compiled for either.
    """
    if request.param == "elsewhere":
        monkeypatch.setattr(
            jax.lax, "platform_dependent", lambda *arguments, default, **_: default(*arguments)
        )
        jax.clear_caches()
    yield request.param
    if request.param == "elsewhere":
        jax.clear_caches()


@pytest.fixture(scope="session")
def shared():
    """Folder of real light fields and reference activations, for tests that can use them."""
    folder = Path(__file__).resolve().parents[2] / "shared"
    if not folder.is_dir():
        pytest.skip("the folder of shared reference data is not beside this checkout")
    return folder


@pytest.fixture(scope="session")
def cache(tmp_path_factory):
    """The user's cache folder; one for all tests, since filling it is most of their time."""
    return tmp_path_factory.mktemp("cache")


@pytest.fixture
def occjax_command(monkeypatch, capsys, cache):
    """Run ``occjax ARGUMENTS``; returns exit code, standard output and standard error."""
    from occjax import cli  # not before the types of all arguments are checked

    monkeypatch.setenv("XDG_CACHE_HOME", str(cache))
    options = ("jax_compilation_cache_dir", "jax_persistent_cache_min_compile_time_secs")
    before = [getattr(jax.config, option) for option in options]

    def command(*arguments):
        monkeypatch.setattr(sys, "argv", ["occjax", *map(str, arguments)])
        with pytest.raises(SystemExit) as stopped:
            cli.main()
        printed = capsys.readouterr()
        return stopped.value.code, printed.out, printed.err

    yield command
    for option, value in zip(options, before, strict=True):
        jax.config.update(option, value)
    # JAX asks once whether there is a cache: all later tests would write to it as well.
    compilation_cache.reset_cache()
