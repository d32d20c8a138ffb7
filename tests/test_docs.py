"""The examples of the documentation run."""

import re
from pathlib import Path

import numpy as np

DOCS = Path(__file__).resolve().parents[1] / "docs"


def test_cost_volume_examples_run_in_their_order():
    text = (DOCS / "cost-volumes.md").read_text(encoding="utf-8")
    variables = {}
    for example in re.findall(r"```python\n(.*?)```", text, re.DOTALL):
        exec(example, variables)
    truth = variables["light_field"].ground_truth
    error = np.abs(np.asarray(variables["disparity"]) - truth)
    assert np.median(error) < 0.1
    assert variables["volume"].shape == (9, *truth.shape, 9)
