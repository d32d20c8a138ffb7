"""A scene of two results for the tests of this folder."""

import numpy as np
import pytest

from occjax.viewer import ViewedResult, ViewedScene
from tests.scenes import plane


@pytest.fixture(scope="session")
def two_results():
    """A plane of disparity 0.5 and two maps of it: exact, and too near on the right half."""
    light_field = plane(grid=(3, 3), size=(24, 32), disparity=0.5)
    exact = light_field.ground_truth
    wrong = exact + np.where(np.arange(32) < 16, 0.0, 1.0).astype(np.float32)
    confidence = np.tile(np.linspace(0.0, 1.0, 32, dtype=np.float32), (24, 1))
    results = (
        ViewedResult("exact", exact, confidence, disparity_range=(-1.0, 2.0)),
        ViewedResult("wrong", wrong, confidence, disparity_range=(-1.0, 2.0)),
    )
    return ViewedScene(results, light_field, "plane")
