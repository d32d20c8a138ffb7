"""Completeness of the published scores, and agreement with the averages that the paper prints."""

from experiments.published_scores import MEASURES, PRINTED_AVERAGE, published_scores
from experiments.score_tables import rounding_error
from experiments.submission import SCENES


def test_nine_methods_have_scores_of_twelve_scenes():
    assert len(published_scores()) == 9
    for scores in published_scores().values():
        assert tuple(scores) == (*SCENES, PRINTED_AVERAGE)
        for scene in SCENES:
            assert set(scores[scene]) == set(MEASURES)
            bad = [scores[scene][f"badpix_{threshold}"] for threshold in ("0.07", "0.03", "0.01")]
            assert bad == sorted(bad)


def test_three_printed_averages_differ_from_the_scores():
    wrong = []
    for method, scores in published_scores().items():
        for measure, printed in scores[PRINTED_AVERAGE].items():
            own = [scores[scene][measure] for scene in SCENES]
            mean = sum(own) / len(own)
            slack = sum(map(rounding_error, own)) / len(own) + rounding_error(printed)
            if abs(mean - printed) > slack:
                wrong.append((method, measure, printed, round(mean, 3)))
    assert wrong == [
        ("SPO", "badpix_0.03", 32.71, 22.299),
        ("FastLFnet", "badpix_0.01", 56.45, 56.42),
        ("OccCasNet", "badpix_0.07", 2.859, 2.857),
    ]


def test_cotton_has_the_scores_of_the_published_disparity_map():
    assert tuple(published_scores()["OccCasNet"]["cotton"].values()) == (0.263, 0.569, 3.057, 0.201)
