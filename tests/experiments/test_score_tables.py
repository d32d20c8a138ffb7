"""Marks compared with those of the paper, and escaped text in Markdown and LaTeX."""

import re

import pytest

from experiments.score_tables import Table, format_score, latex, markdown, ranks, rounding_error


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (0.0, "0.000"),
        (0.0125001, "0.013"),
        (9.9994, "9.999"),
        (9.9996, "10.00"),
        (99.994, "99.99"),
        (99.996, "100.0"),
        (12345.67, "12345.7"),
    ],
)
def test_numbers_have_four_digits_and_at_most_three_decimals(value, text):
    assert format_score(value) == text
    assert abs(float(text) - value) <= rounding_error(value)


def test_equal_printed_numbers_share_a_rank():
    assert ranks([0.0041, 0.0031, 0.0039, None, 0.005]) == (2, 1, 2, None, 3)
    assert ranks([None, None]) == (None, None)


def test_marks_match_the_paper_except_one(shared):
    """In the paper the best is red and the second best is blue."""
    (paper,) = (shared / "paper").glob("*.txt")
    tables = re.findall(
        r"Avg\. (BP 0\.0\d|MSE) \\\\(.*?)\\bottomrule", paper.read_text(), re.DOTALL
    )
    assert len(tables) == 4
    wrong = []
    for measure, text in tables:
        rows = [line.split("&") for line in text.split(r"\\") if line.count("&") == 13]
        assert len(rows) == 9
        for column in range(1, 14):
            cells = [row[column] for row in rows]
            places = ranks([float(re.search(r"[\d.]+", cell)[0]) for cell in cells])
            for row, cell, place in zip(rows, cells, places, strict=True):
                printed = 1 if "red" in cell else 2 if "blue" in cell else None
                if printed != (place if place < 3 else None):
                    wrong.append((measure, column, row[0].strip()[:6], place, printed))
    assert wrong == [("MSE", 1, "Epinet", 2, None), ("MSE", 1, "OccCas", 3, 2)]


TABLE = Table(
    "MSE x100",
    ("dots", "average"),
    {"mine_2 50%": (0.3, None), "a|b": (0.2, 1.5), "third": (0.4, 1.5)},
    {("a|b", "average"): 1.7},
)


def test_markdown_marks_the_best_and_the_second_best():
    assert markdown([TABLE], ["A note."]).splitlines() == [
        "| MSE x100 | dots | average |",
        "|---|---:|---:|",
        "| mine_2 50% | <u>0.300</u> | – |",  # noqa: RUF001
        r"| a\|b | **0.200** | **1.500** (1.700) |",
        "| third | 0.400 | **1.500** |",
        "",
        "A note.",
    ]


def test_latex_marks_the_same_and_escapes_names():
    lines = latex([TABLE], ["x_1: 3 %."]).splitlines()
    assert lines[:2] == [r"\begin{tabular}{lrr}", r"\toprule"]
    assert r"mine\_2 50\% & \underline{0.300} & -- \\" in lines
    assert r"a|b & \textbf{0.200} & \textbf{1.500} (1.700) \\" in lines
    assert lines[-1] == r"\noindent x\_1: 3 \%."
