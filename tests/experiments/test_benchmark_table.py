"""Scores of maps known by construction, and the paper's column from its published map."""

from functools import partial
from pathlib import Path

import numpy as np
import pytest

from experiments import benchmark_table
from experiments.submission import SCENES, TEST
from occjax.io import write_pfm


@pytest.fixture
def run(script):
    """Return a function that runs the script."""
    return partial(script, benchmark_table.run)


def cells(printed):
    """Return the cells of printed tables by title, row and column, without marks."""
    found = {}
    for block in printed.split("\n\n"):
        rows = [
            [cell.strip().strip("*") for cell in line.split("|")[1:-1]]
            for line in block.splitlines()
            if line.startswith("|")
        ]
        for row in rows[2:]:
            for column, cell in zip(rows[0][1:], row[1:], strict=True):
                found[rows[0][0], row[0], column] = cell.replace("<u>", "").replace("</u>", "")
    return found


@pytest.fixture
def benchmark(tmp_path):
    """Folder with public ground truth, and with estimates of known errors."""
    shape = (120, 120)
    for number, scene in enumerate(SCENES):
        folder = tmp_path / "hci" / ("test" if scene in TEST else "training") / scene
        folder.mkdir(parents=True)
        if scene not in TEST:
            write_pfm(folder / "gt_disp_lowres.pfm", np.full(shape, number, np.float32))
        write_pfm(tmp_path / f"flat/{scene}.pfm", np.full(shape, number + 0.02, np.float32))
        if scene not in ("dots", "dino"):
            estimate = np.full(shape, number, np.float32)
            estimate[:, :87] += 0.05  # 72 of the 90 columns within the border
            write_pfm(tmp_path / f"results/{scene}/disparity.pfm", estimate)
    return tmp_path


def test_committed_tables_match_the_script(run):
    code, out, err = run()
    assert (code, err) == (0, "")
    committed = Path(benchmark_table.__file__).with_suffix(".md").read_text(encoding="utf-8")
    assert out == committed


def test_deviating_averages_of_the_paper_follow_in_brackets(run):
    table = cells(run()[1])
    both = {key: cell for key, cell in table.items() if "(" in cell}
    assert both == {
        ("BadPix 0.07", "OccCasNet", "average"): "2.857 (2.859)",
        ("BadPix 0.03", "SPO", "average"): "22.30 (32.71)",
        ("BadPix 0.01", "FastLFnet", "average"): "56.42 (56.45)",
    }
    assert table["MSE x100", "OccCasNet", "average"] == "1.554"
    assert len(table) == 4 * 9 * 13


def test_measured_methods_follow_the_published_ones(run, benchmark):
    code, out, err = run(
        f"flat={benchmark / 'flat'}",
        f"most={benchmark / 'results'}",
        "--truth",
        benchmark / "hci",
        "-o",
        benchmark / "tables",
    )
    assert (code, err) == (0, "")
    table = cells(out)
    for measure, flat, most in (
        ("BadPix 0.07", "0.000", "0.000"),
        ("BadPix 0.03", "0.000", "80.00"),
        ("BadPix 0.01", "100.0", "80.00"),
        ("MSE x100", "0.040", "0.200"),
        ("Q25 x100", "2.000", "5.000"),
    ):
        assert table[measure, "flat", "cotton"] == flat
        assert table[measure, "flat", "dots"] == flat
        assert table[measure, "most", "dots"] == "–"  # noqa: RUF001
        assert table[measure, "flat", "herbs"] == "–"  # noqa: RUF001
        assert table[measure, "flat", "average"] == "–"  # noqa: RUF001
        assert table[measure, "flat", "average of 6"] == flat
        assert table[measure, "most", "average of 6"] == most
    # OccCasNet's MSE on the six scenes that both have: 3.834, 0.004, 0.889, 2.678, 0.201, 0.397.
    assert table["MSE x100", "OccCasNet", "average of 6"] == "1.334"
    assert ("Q25 x100", "OccCasNet", "cotton") not in table
    assert "flat: no ground truth: bedroom, bicycle, herbs, origami." in out
    assert "most: no estimate: dots, dino; no ground truth: bedroom," in out
    written = {path.name for path in (benchmark / "tables").iterdir()}
    assert written == {"benchmark_table.md", "benchmark_table.tex"}
    assert (benchmark / "tables/benchmark_table.md").read_text(encoding="utf-8") == out


def test_published_map_of_cotton_has_the_scores_of_the_paper(run, shared, tmp_path):
    maps = shared / "data/hci/cotton_maps"
    (tmp_path / "hci/training").mkdir(parents=True)
    (tmp_path / "hci/training/cotton").symlink_to(maps)
    (tmp_path / "maps").mkdir()
    (tmp_path / "maps/cotton.pfm").symlink_to(maps / "occcasnet_published.pfm")
    table = cells(run(f"map={tmp_path / 'maps'}", "--truth", tmp_path / "hci")[1])
    measures = ("BadPix 0.07", "BadPix 0.03", "BadPix 0.01", "MSE x100")
    for method in ("map", "OccCasNet"):
        for column in ("cotton", "average of 1"):
            found = [table[measure, method, column] for measure in measures]
            assert found == ["0.263", "0.569", "3.057", "0.201"]


def test_pixels_without_an_estimate_are_reported(run, benchmark):
    estimate = np.full((120, 120), 0.02, np.float32)
    estimate[20:29, 15:42] = np.nan  # 243 of the 90x90 pixels within the border
    write_pfm(benchmark / "flat/backgammon.pfm", estimate)
    out = run(f"flat={benchmark / 'flat'}", "--truth", benchmark / "hci")[1]
    assert cells(out)["BadPix 0.07", "flat", "backgammon"] == "3.000"
    assert "pixels without an estimate: backgammon (243)" in out


def test_smoke_test_has_the_known_scores(run):
    code, out, err = run("--small")
    assert (code, err) == (0, "")
    table = cells(out)
    for measure, score in (
        ("BadPix 0.07", "0.000"),
        ("BadPix 0.03", "0.000"),
        ("BadPix 0.01", "100.0"),
        ("MSE x100", "0.040"),
        ("Q25 x100", "2.000"),
    ):
        assert table[measure, "moved by 0.02", "average"] == score


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (("flat", "--truth", "hci"), "'flat': is not NAME=FOLDER"),
        (("=flat", "--truth", "hci"), "is not NAME=FOLDER"),
        (("flat=flat",), "pass --truth HCI"),
        (("CAE=flat", "--truth", "hci"), "CAE: is the name of two methods"),
        (("a=flat", "a=flat", "--truth", "hci"), "a: is the name of two methods"),
        (("a=nowhere", "--truth", "hci"), "nowhere: is not a folder"),
        (("a=flat", "--truth", "nowhere"), "nowhere: is not a folder"),
        (("a=hci", "--truth", "hci"), "hci: has no <scene>.pfm"),
        (("a=other", "--truth", "hci"), "cotton.pfm against"),
        (("a=flat", "--truth", "hci", "--small"), "remove the methods"),
        (("-o", "flat/dots.pfm"), "dots.pfm"),
    ],
)
def test_bad_input_is_one_line_and_code_2(run, benchmark, monkeypatch, arguments, says):
    monkeypatch.chdir(benchmark)
    write_pfm(benchmark / "other/cotton.pfm", np.zeros((50, 40)))
    code, _, err = run(*arguments)
    assert (code, err.count("\n")) == (2, 1)
    assert says in err
