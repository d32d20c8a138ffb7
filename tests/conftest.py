"""Strict JAX for every test, the table of tolerances, and fixtures that all tests share."""

import sys
from pathlib import Path

import jax
import jaxtyping
import pytest
from jax.experimental.compilation_cache import compilation_cache

jax.config.update("jax_numpy_dtype_promotion", "strict")
jax.config.update("jax_numpy_rank_promotion", "raise")

TOLERANCE = {
    # Sums of up to a few hundred values, in another order.
    "float64": {"rtol": 1e-12, "atol": 1e-12},
    "float32": {"rtol": 1e-5, "atol": 1e-5},
    "bfloat16": {"rtol": 3e-2, "atol": 3e-2},
    # A few roundings in float32: of values of any size, and of values up to about one and zero.
    "relative": {"rtol": 1e-6},
    "absolute": {"rtol": 0, "atol": 1e-6},
    # Convolutions in float32, compiled in two ways: their sums cancel.
    "convolution": {"rtol": 0, "atol": 1e-5},
    # Roundings in float32 that a difference of close values amplifies.
    "amplified": {"rtol": 1e-4, "atol": 1e-4},
    # Central differences in float64 with a step of 1e-6: rounding of values near one.
    "finite difference": {"rtol": 1e-6, "atol": 1e-7},
    # Storage: one rounding to half precision, of values from 0 to 1 to 8 bits, of colours to one
    # of the 256 of a colour map.
    "float16": {"rtol": 5e-4, "atol": 3e-8},
    "8 bit": {"rtol": 0, "atol": 0.5001 / 255},
    "colour": {"rtol": 0, "atol": 1},
}
"""Arguments of ``np.testing.assert_allclose``, by reason of the difference."""


@pytest.fixture(scope="session", autouse=True)
def optimised_view_order_check():
    """Optimise the one program that runs for longer than it compiles, a hundred times per check."""
    from occjax.layout import consistency  # after pytest has installed the check of annotations

    options = {"xla_backend_optimization_level": 2, "xla_cpu_use_fusion_emitters": True}
    consistency.arm_volume = jax.jit(
        consistency.arm_volume.__wrapped__, static_argnames="radius", compiler_options=options
    )


def pytest_runtest_setup(item):
    if item.get_closest_marker("gpu") and jax.default_backend() != "gpu":
        pytest.skip("needs a GPU: set JAX_PLATFORMS=cuda")


@pytest.fixture
def tolerance():
    """Keyword arguments of ``np.testing.assert_allclose`` from a row of the table."""
    return TOLERANCE.__getitem__


@pytest.fixture
def x64():
    """Double precision for one test."""
    with jax.enable_x64(True):
        yield


@pytest.fixture
def unchecked():
    """No run-time check of annotations, as for users."""
    jaxtyping.config.update("jaxtyping_disable", True)
    yield
    jaxtyping.config.update("jaxtyping_disable", False)


@pytest.fixture(params=["cpu", pytest.param("default", marks=pytest.mark.slow)])
def platform(request, monkeypatch):
    """Run the test with the programs for a CPU and, if slow tests run, with those for a GPU.

    The programs for a GPU run on the CPU. Applies to functions that are jitted within the test.
    """
    if request.param == "default":
        monkeypatch.setattr(
            jax.lax, "platform_dependent", lambda *arguments, default, **_: default(*arguments)
        )
        jax.clear_caches()
    yield request.param
    if request.param == "default":
        jax.clear_caches()


@pytest.fixture(scope="session")
def shared():
    """Folder of real light fields and reference activations; skips the test if there is none."""
    folder = Path(__file__).resolve().parents[2] / "shared"
    if not folder.is_dir():
        pytest.skip("there is no folder of shared reference data next to this checkout")
    return folder


@pytest.fixture(scope="session")
def cache(tmp_path_factory):
    """The user's cache folder, the same for all tests: filling it takes most of their time."""
    return tmp_path_factory.mktemp("cache")


@pytest.fixture
def occjax_command(monkeypatch, capsys, cache):
    """Run ``occjax ARGUMENTS``; returns exit code, standard output and standard error."""
    from occjax import cli  # after pytest has installed the check of annotations

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
    # JAX opens a cache once per process: without this, all later tests would use the user's.
    compilation_cache.reset_cache()
