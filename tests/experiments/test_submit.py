"""Smoke test of submissions; missing input is reported before any estimate."""

import zipfile
from functools import partial

import numpy as np
import pytest

from experiments import submit
from experiments.submission import SCENES, write_submission
from occjax.data.bundled_sample import sample
from occjax.io import read_pfm
from tests.io.files import save_views


@pytest.fixture
def run(script):
    """Return a function that runs the script."""
    return partial(script, submit.COMMANDS)


TRIAL = ("--small", "--model", "photometric")


@pytest.mark.slow
def test_smoke_test_makes_a_submission_and_resumes(run, tmp_path):
    file = tmp_path / "one.zip"
    code, out, err = run("make", *TRIAL, "-o", file, "--scenes", "dino")
    assert (code, err) == (0, "")
    assert "1 scenes of 64x64 pixels, an incomplete submission" in out
    # dino is the square in the sample's second row and third column.
    error = read_pfm(tmp_path / "one/disp_maps/dino.pfm") - sample().ground_truth[64:128, 128:192]
    assert np.median(np.abs(error)) < 0.05
    kept = tmp_path / "one/runtimes/dino.txt"
    kept.write_text("1234.5")
    code, out, err = run("make", *TRIAL, "-o", file, "--scenes", "dots", "dino")
    assert code == 0
    with zipfile.ZipFile(file) as archive:
        assert len(archive.namelist()) == 4
        assert float(archive.read("runtimes/dino.txt")) == 1234.5
        assert 0.0 < float(archive.read("runtimes/dots.txt")) < 600.0
    code, out, err = run("validate", file)
    assert code == 1
    assert len(out.splitlines()) == 2 + 2 * 10
    assert "disp_maps/dino.pfm: has 64x64 pixels, not 512x512" in out
    assert "runtimes/herbs.txt: is missing" in out
    kept.write_text("soon")
    code, _, err = run("make", *TRIAL, "-o", file, "--scenes", "dino")
    assert (code, err.count("\n")) == (2, 1)
    assert "dino.txt: cannot be decoded as a number of seconds" in err


def test_valid_submission_has_no_faults(run, tmp_path):
    maps = dict.fromkeys(SCENES, np.zeros((512, 512), np.float32))
    write_submission(tmp_path / "one.zip", maps, dict.fromkeys(SCENES, 1.0))
    code, out, err = run("validate", tmp_path / "one.zip")
    assert (code, err) == (0, "")
    assert out.startswith(f"{tmp_path / 'one.zip'}: valid, 12 disparity maps of 512x512 pixels")


@pytest.fixture
def benchmark(tmp_path):
    """Folder of unpacked scenes with black views of the benchmark's size."""
    views = np.zeros((9, 9, 512, 512, 3), np.uint8)
    folder = save_views(tmp_path / "hci/training/cotton", views[:1, :1], lambda v, u: "0.png")
    for number in range(81):
        (folder / f"input_Cam{number:03d}.png").symlink_to(folder / "0.png")
    (tmp_path / "hci/test/herbs").mkdir(parents=True)
    return tmp_path / "hci"


@pytest.mark.parametrize(
    ("scenes", "broken", "says"),
    [
        (("cotton", "dots", "dino"), None, "has no folder dots, dino"),
        (("cotton", "herbs"), None, "herbs: input_Cam000.png is missing, and 80 other views"),
        (("cotton",), "input_Cam057.png", "cotton: input_Cam057.png is missing; unpack"),
    ],
)
def test_missing_input_is_reported_before_any_estimate(
    run, benchmark, tmp_path, monkeypatch, scenes, broken, says
):
    monkeypatch.setattr(submit, "run_estimator", None)  # estimating would fail
    if broken:
        (benchmark / "training/cotton" / broken).unlink()
    code, _, err = run("make", benchmark, "-o", tmp_path / "one.zip", "--scenes", *scenes)
    assert (code, err.count("\n")) == (2, 1)
    assert says in err
    assert not (tmp_path / "one").exists()


def test_views_of_another_size_and_repeated_scenes_are_rejected(run, benchmark, tmp_path):
    save_views(tmp_path / "hci/test/herbs", np.zeros((9, 9, 16, 16, 3), np.uint8), nine_by_nine)
    arguments = ("make", benchmark, "-o", tmp_path / "one.zip", "--scenes")
    assert "is 16x16 pixels, not 512x512" in run(*arguments, "herbs")[2]
    (benchmark / "other/cotton").mkdir(parents=True)
    assert "remove one of them" in run(*arguments, "cotton")[2]


def nine_by_nine(v, u):
    return f"input_Cam{9 * v + u:03d}.png"


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (("make", "-o", "one.zip"), "name the folder"),
        (("make", "nowhere", "-o", "one.zip"), "nowhere: is not a folder"),
        (("make", "--small", "-o", "one"), "ends with .zip"),
        (
            ("make", "--small", "-o", "one.zip", "--scenes", "coton"),
            "'coton' is not a benchmark scene",
        ),
        (("make", "--small", "-o", "one.zip", "--scenes", "dots", "dots"), "named twice"),
        (("make", "--small", "-o", "one.zip", "--scenes"), "--scenes has no names"),
        (("make", "--small", "-o", "one.zip", "--model", "occcasnet"), "needs weights"),
        (("make", *TRIAL, "-o", "mine.zip"), "mine: exists with other content"),
        (("make", *TRIAL, "-o", "made.zip"), "made/settings.json: cannot be decoded"),
        (("validate", "nowhere.zip"), "nowhere.zip: there is no such file"),
    ],
)
def test_bad_input_is_one_line_and_code_2(run, tmp_path, monkeypatch, arguments, says):
    monkeypatch.chdir(tmp_path)
    for folder, file in (("mine", "thesis.txt"), ("made", "settings.json")):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / file).write_text("{}")
    code, out, err = run(*arguments)
    assert (code, out, err.count("\n")) == (2, "", 1)
    assert says in err
