"""All scripts are tried and listed; what is tried is kept, and what fails is said."""

import ast
import inspect
from pathlib import Path

import pytest
from PIL import Image

from experiments import small_forms
from experiments.command_line import main

HERE = Path(small_forms.__file__).parent
PACKAGES = {path.parent.name for path in HERE.glob("*/__main__.py")}
SCRIPTS = {path.stem for path in HERE.glob("*.py") if '__name__ == "__main__"' in path.read_text()}


def test_every_script_has_its_small_form_here():
    assert set(small_forms.FORMS) == SCRIPTS - {"small_forms"}
    kept = {place.name for place in (HERE / "small").iterdir()}
    assert kept == set(small_forms.FORMS)


@pytest.mark.parametrize("name", sorted(SCRIPTS))
def test_every_script_can_be_called(name):
    """Their own tests call functions; a fault in how the file calls ``main`` is seen here alone."""
    source = ast.parse((HERE / f"{name}.py").read_text())
    (call,) = (node.value for node in source.body[-1].body)
    inspect.signature(main).bind(*call.args, *call.keywords)


def test_the_list_of_scripts_is_whole():
    rows = (HERE / "README.md").read_text().splitlines()
    listed = {row.split("`")[1]: row.split(" | ") for row in rows if row.startswith("| `")}
    assert set(listed) == SCRIPTS | PACKAGES
    for name, cells in listed.items():
        assert len(cells) == 6
        assert f"`python -m experiments.{name}" in cells[2]


def test_what_is_printed_and_drawn_is_kept(script, tmp_path, monkeypatch):
    monkeypatch.setattr(small_forms, "LARGEST", 40_000)
    code, out, _ = script(small_forms.run, "compare_methods", "benchmark_table", "-o", tmp_path)
    assert (code, out) == (0, "compare_methods\nbenchmark_table\n")
    kept = {str(path.relative_to(tmp_path)): path for path in tmp_path.glob("*/*")}
    assert set(kept) == {
        *(f"compare_methods/{name}" for name in ("printed.md", "moved_against_half.png")),
        # These are large.
        "compare_methods/radar.webp",
        *(f"benchmark_table/{name}" for name in ("printed.md", "benchmark_table.webp")),
    }
    assert max(path.stat().st_size for path in kept.values()) < 200_000
    with Image.open(kept["benchmark_table/benchmark_table.webp"]) as image:
        assert image.width > 1000
    printed = kept["compare_methods/printed.md"].read_text()
    assert "scores.md, radar.webp, moved_against_half.png" in printed
    assert printed.endswith(" written to FOLDER\n")


def test_a_script_that_fails_is_named(script, tmp_path, monkeypatch):
    monkeypatch.setattr(small_forms, "FORMS", {"figures": ("-o", "FOLDER", "--points", "a")})
    code, out, _ = script(small_forms.run, "-o", tmp_path)
    assert code == 1
    assert out.startswith("figures failed:\n")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("name", ["figure", ""])
def test_an_unknown_script_is_one_line_and_code_2(script, tmp_path, name):
    code, _, err = script(small_forms.run, name, "-o", tmp_path)
    assert (code, err.count("\n")) == (2, 1)
    assert f"no script named {name!r}; there are ablation, " in err
