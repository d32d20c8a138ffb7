"""Smoke test of the robustness experiment, which must show its main effects."""

import pytest

from experiments import photometric_robustness


@pytest.mark.slow
def test_noise_increases_the_error_and_exposure_does_not(capsys, monkeypatch):
    monkeypatch.setattr(photometric_robustness, "GRIDS", ((9, 9), (3, 3)))
    monkeypatch.setattr(photometric_robustness, "NOISE_LEVELS", (16.0,))
    monkeypatch.setattr(photometric_robustness, "EXPOSURE_DIVISORS", (16,))
    results = photometric_robustness.run(small=True)
    bad = {name: metrics.badpix[0.07] for name, metrics in results.items()}
    assert bad["noise 16/255"] > bad["9x9 views"]
    assert abs(bad["exposure 1/16"] - bad["9x9 views"]) < 1.0
    printed = capsys.readouterr().out.splitlines()
    assert len(printed) == 2 + len(results)
    assert f"| 9x9 views | {results['9x9 views'].mse_x100:.2f} |" in printed[2]
