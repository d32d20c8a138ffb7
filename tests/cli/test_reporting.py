"""``occjax report`` and ``occjax estimate --report``."""

import json

import pytest

pytest.importorskip("jinja2")

FAST = ("--model", "photometric", "--disparity-range", "-1", "2")


def test_estimates_are_reported_at_once_or_later(run, scene, tmp_path):
    code, out, err = run("estimate", scene, "-o", tmp_path / "out", *FAST, "--report")
    assert code == 0, err
    assert f"report: {tmp_path / 'out/report.html'}" in out
    page = (tmp_path / "out/report.html").read_text("utf-8")
    assert "data-occlusion" in page
    command = json.loads((tmp_path / "out/scene/summary.json").read_text())["command"]
    assert command.startswith("occjax estimate ")
    assert "<code>occjax estimate" in page

    code, out, err = run("estimate", scene, "-o", tmp_path / "out", *FAST, "--report")
    assert (code, "report: " in out) == (0, True)  # of the estimate that is complete already

    code, out, err = run("report", tmp_path / "out", "-o", tmp_path / "later.html")
    assert (code, out) == (0, f"{tmp_path / 'later.html'}: 1 scene\n")
    assert "Comparison with the ground truth" in (tmp_path / "later.html").read_text("utf-8")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((), "pass at least one folder"),
        (("absent",), "absent"),
        (("absent", "-o", "report.pdf"), "use the suffix .html"),
    ],
)
def test_what_cannot_be_reported_is_explained(run, arguments, message, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    code, _, err = run("report", *arguments)
    assert code == 2
    assert message in err
    assert not list(tmp_path.iterdir())
