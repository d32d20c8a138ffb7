"""Sparsification curves: closed form, and a run of the experiment."""

import numpy as np
import pytest

from experiments import sparsification


def test_curve_of_wrong_pixels_that_are_the_least_certain_ones():
    """A tenth is wrong: nothing is left without it, and half of it is a nineteenth of the rest."""
    errors = np.repeat([1.0, 0.0], [10, 90])
    found = sparsification.curve(errors, np.arange(100.0))
    np.testing.assert_array_equal(found.badpix, found.ideal)
    assert found.without(0.0) == 10.0
    assert found.without(0.05) == pytest.approx(100 / 19)
    assert found.without(0.1) == 0.0
    opposite = sparsification.curve(errors, -np.arange(100.0))
    assert opposite.without(0.9) == 100.0


@pytest.mark.slow
def test_confidence_finds_the_wrong_pixels(tmp_path, capsys):
    curves = sparsification.run(small=True, figure=tmp_path / "curves.png")
    for each in curves.values():
        assert each.without(0.2) < 0.7 * each.without(0.0)
        assert each.ideal.mean() <= each.badpix.mean() < each.badpix[-1]
    assert (tmp_path / "curves.png").stat().st_size > 10_000
    assert len(capsys.readouterr().out.splitlines()) == 2 + len(curves)
