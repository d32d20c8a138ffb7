"""Published scores: whole, and in agreement with what else the paper prints."""

import pytest

from occjax.errors import InputError
from occjax.evaluation import published


def test_nine_methods_are_known_on_twelve_scenes():
    assert len(published.published_methods()) == 9
    for method in published.published_methods():
        scores = published.published_scores(method)
        assert tuple(scores) == published.SCENES
        for scene in scores.values():
            assert set(scene) == set(published.MEASURES)
            # The stricter the threshold, the more pixels are bad.
            assert scene["badpix_0.07"] <= scene["badpix_0.03"] <= scene["badpix_0.01"]


def test_averages_are_as_printed_but_for_three():
    wrong = []
    for method in published.published_methods():
        scores = published.published_scores(method)
        found = published.average(scores)
        for measure, printed in published.printed_average(method).items():
            # At most four digits and three decimals are printed, of the scores and of their mean.
            rounded = [0.0005 if own[measure] < 10.0 else 0.005 for own in scores.values()]
            slack = sum(rounded) / 12 + (0.0005 if printed < 10.0 else 0.005)
            if abs(found[measure] - printed) > slack:
                wrong.append((method, measure, printed, round(found[measure], 3)))
    assert wrong == [
        ("SPO", "badpix_0.03", 32.71, 22.299),
        ("FastLFnet", "badpix_0.01", 56.45, 56.42),
        ("OccCasNet", "badpix_0.07", 2.859, 2.857),
    ]


def test_the_columns_that_are_quoted_elsewhere():
    """Cotton's of OccCasNet, as the published disparity map scores too; the paper's abstract."""
    cotton = published.published_scores("OccCasNet")["cotton"]
    assert tuple(cotton.values()) == (0.263, 0.569, 3.057, 0.201)
    averages = [
        published.printed_average(name)["mse_x100"] for name in published.published_methods()
    ]
    assert min(averages) == published.printed_average("OccCasNet")["mse_x100"]


def test_unknown_methods_are_told_with_those_that_there_are():
    with pytest.raises(InputError, match=r"'epinet'; there are CAE, SPO, Epinet-fcn-m"):
        published.published_scores("epinet")
    with pytest.raises(InputError, match="no scenes"):
        published.average({})
