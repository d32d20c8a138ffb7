"""Smoke test of the robustness experiment, which must show its main effects."""

import pytest

from experiments import robustness


@pytest.mark.slow
def test_noise_increases_the_error_and_exposure_does_not(capsys, monkeypatch):
    monkeypatch.setattr(robustness, "MODELS", ("photometric",))
    monkeypatch.setattr(robustness, "GRIDS", ((9, 9),))
    monkeypatch.setattr(robustness, "NOISE_LEVELS", (16.0,))
    (results,) = robustness.run(small=True).values()
    bad = {
        name: result.scores["photometric"].metrics.badpix[0.07] for name, result in results.items()
    }
    assert bad["noise 16/255"] > bad["9x9 views"]
    assert abs(bad["exposure 1/16"] - bad["9x9 views"]) < 1.0
    assert bad["exposure of each view +-30%"] < 2 * bad["9x9 views"]
    assert results["noise 16/255"].measured_fraction < results["9x9 views"].measured_fraction
    printed = capsys.readouterr().out.splitlines()
    assert len(printed) == 2 + len(results)
    metrics = results["9x9 views"].scores["photometric"].metrics
    assert f" | 9x9 views | 100.0% | {metrics.mse_x100:.2f}, " in printed[2]
