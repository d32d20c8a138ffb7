"""Fast compilation for the tests and for the examples in the docstrings."""

import gc
import os
import shutil
import tempfile

# Compilation takes most of the time of the tests. Without optimisation and without the fusion
# emitters, which generate code by way of MLIR, it takes a quarter of its time.
os.environ.setdefault(
    "XLA_FLAGS",
    "--xla_force_host_platform_device_count=2"
    " --xla_backend_optimization_level=0 --xla_cpu_use_fusion_emitters=false",
)
os.environ.setdefault("JAX_PLATFORMS", "cpu")
os.environ.setdefault("MPLBACKEND", "Agg")
# The threads of BLAS wait actively, and the products of the tests are small.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import jax

# Imports and tracing make many objects that live on: searching them for garbage takes a fifth of
# the time.
gc.set_threshold(100_000, 50, 50)

XLA_CACHE = "OCCJAX_TEST_XLA_CACHE"
"""Environment variable with the folder in which all processes of a test run share programs."""


def pytest_configure(config):
    """Share compiled programs within one test run, between its processes and files.

    The first process makes the folder and removes it at its end, when the other processes have
    ended: JAX must not write to a folder that does not exist any more.
    """
    if XLA_CACHE not in os.environ:
        os.environ[XLA_CACHE] = folder = tempfile.mkdtemp(prefix="occjax-tests-xla-")
        config.add_cleanup(lambda: shutil.rmtree(folder, ignore_errors=True))
        config.add_cleanup(lambda: os.environ.pop(XLA_CACHE, None))
    os.environ.setdefault("JAX_COMPILATION_CACHE_DIR", os.environ[XLA_CACHE])  # of child processes
    os.environ.setdefault("JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS", "0.1")
    jax.config.update("jax_compilation_cache_dir", os.environ[XLA_CACHE])
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.1)


def pytest_collection_finish():
    """Do not search what has been imported for garbage."""
    gc.freeze()
