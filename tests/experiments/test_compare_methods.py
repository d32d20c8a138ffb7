"""Two estimates of a small scene with known scores."""

import imageio.v3 as imageio
import numpy as np
import pytest

from experiments import compare_methods
from occjax.errors import InputError
from occjax.io import write_pfm


@pytest.fixture
def files(tmp_path):
    """Scene, a perfect estimate, and one that is wrong in half of the discontinuities."""
    scene = tmp_path / "small"
    scene.mkdir()
    truth = np.zeros((40, 40), np.float32)
    write_pfm(scene / "gt_disp_lowres.pfm", truth)
    mask = np.zeros(truth.shape, np.uint8)
    mask[18:20, 18:22] = 255
    imageio.imwrite(scene / "mask_discontinuities_lowres.png", mask)
    write_pfm(tmp_path / "perfect.pfm", truth)
    truth[18] += 1.0
    write_pfm(tmp_path / "wrong.pfm", truth)
    return scene, (f"wrong={tmp_path / 'wrong.pfm'}", f"perfect={tmp_path / 'perfect.pfm'}")


def test_table_and_figures_are_written(files, tmp_path, capsys):
    scene, estimates = files
    scores = compare_methods.run(scene, estimates, output=tmp_path / "out")
    assert scores["wrong"].values["discontinuities"] == 50.0
    written = {path.name for path in (tmp_path / "out").iterdir()}
    assert written == {"scores.md", "radar.png", "wrong_against_perfect.png"}
    table = (tmp_path / "out/scores.md").read_text()
    printed = capsys.readouterr().out
    names = "scores.md, radar.png, wrong_against_perfect.png"
    assert printed == f"{table}\n{names} written to {tmp_path / 'out'}\n"
    assert "| measure | wrong | perfect |\n" in table
    assert "| discontinuities | 50.000 | 0.000 |\n" in table
    assert "runtime" not in table  # neither has one


@pytest.mark.parametrize("estimate", ["a", "a=", "=a.pfm", "a/b=c.pfm"])
def test_estimate_needs_a_name_valid_in_a_file_name(estimate):
    with pytest.raises(InputError, match="is not NAME=ESTIMATE"):
        compare_methods.parse_named((estimate,))


def test_repeated_name_is_rejected():
    with pytest.raises(InputError, match="two estimates"):
        compare_methods.parse_named(("a=b.pfm", "a=c.pfm"))


def test_smoke_test_has_the_known_scores(script, tmp_path):
    code, out, err = script(compare_methods.run, "--small", "-o", tmp_path)
    assert (code, err) == (0, "")
    assert {path.name for path in tmp_path.iterdir()} == {
        *("scores.md", "radar.png", "moved_against_half.png")
    }
    table = out.split("\n\n")[0].splitlines()
    cells = [[cell.strip() for cell in line.split("|")[1:-1]] for line in table]
    assert cells[0] == ["measure", "moved", "half"]
    assert {name: (float(moved), float(half)) for name, moved, half in cells[2:]} == {
        "mse_x100": (0.04, 0.5),
        "badpix_0.07": (0.0, 50.0),
        "badpix_0.03": (0.0, 50.0),
        "badpix_0.01": (100.0, 50.0),
        "q25_x100": (2.0, 0.0),
    }


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        ((), "or pass --small alone"),
        (("scene",), "one or more NAME=ESTIMATE"),
        (("scene", "a=a.pfm", "--small"), "remove the scene"),
        (("scene", "a.pfm"), "is not NAME=ESTIMATE"),
    ],
)
def test_bad_input_is_one_line_and_code_2(script, tmp_path, arguments, says):
    code, out, err = script(compare_methods.run, *arguments, "-o", tmp_path / "out")
    assert (code, out, err.count("\n")) == (2, "", 1)
    assert says in err
