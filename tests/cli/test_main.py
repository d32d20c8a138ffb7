"""The command as a program: what it imports, its exit codes and its streams."""

import subprocess
import sys

import pytest

import occjax
from occjax.cli.main import COMMANDS, SHELLS
from occjax.models import PRESETS

HEAVY = ("jax", "flax", "matplotlib", "scipy", "PIL", "tifffile")


def imported_by(code):
    """Run code in a new process and return the heavy packages that it imported."""
    code = f"import sys\n{code}\nprint([name for name in {HEAVY} if name in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return done.stdout.splitlines()[-1]


@pytest.mark.parametrize("argument", ["--help", "--version"])
def test_help_and_version_import_no_heavy_packages(argument):
    code = (
        f"sys.argv = ['occjax', '{argument}']\nfrom occjax.cli import main\n"
        "try:\n    main()\nexcept SystemExit as exit:\n    assert exit.code in (0, None)"
    )
    assert imported_by(code) == "[]"


def test_a_wrong_argument_is_reported_without_heavy_packages():
    """One process imports all commands but ``convert``, which needs two of the packages."""
    code = (
        "from occjax.cli import main\n"
        "for command in {commands}:\n"
        "    sys.argv = ['occjax', command, '--no-such-option']\n"
        "    try:\n        main()\n    except SystemExit as exit:\n        assert exit.code == 2"
    )
    others = sorted(COMMANDS.keys() - {"convert"})
    assert imported_by(code.format(commands=others)) == "[]"
    assert imported_by(code.format(commands=["convert"])) == "['PIL', 'tifffile']"


def test_import_of_the_library_does_not_import_jax():
    assert imported_by("import occjax, occjax.lightfield, occjax.errors") == "[]"


def test_version_is_printed(run):
    code, out, _ = run("--version")
    assert (code, out) == (0, f"occjax {occjax.__version__}\n")


def test_help_lists_all_commands(run):
    code, out, _ = run("--help")
    assert code == 0
    for command in COMMANDS:
        assert f"\n  {command} " in out


@pytest.mark.parametrize("shell", SHELLS)
def test_the_completion_script_knows_commands_and_options(run, shell):
    code, out, _ = run("--print-completion", shell)
    assert not code  # SystemExit without a code
    assert "estimate" in out
    assert "--disparity-range" in out


def test_missing_arguments_are_named(run):
    for command in ("train", "pool", "evaluate"):
        code, _, err = run(command)
        assert (code, "required" in err.lower()) == (2, True)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("estimat", "scene"), "estimat is not a command; did you mean 'estimate'?"),
        (("scene.npz",), "the commands are estimate, demo, view"),
        (("estimate", "absent", "-o", "out"), "absent"),
        (("estimate", "-o", "out"), "pass at least one scene"),
        (("--print-completion",), "pass the name of a shell"),
        (("estimate", "absent", "-o", "out", "--model", "occcasnet"), "needs weights"),
        (("estimate", "a", "-o", "out", "--model", "photometrik"), "did you mean 'photometric'?"),
        (("estimate", "a", "-o", "out", "--weights", "Proposl"), "did you mean 'proposal'?"),
        (("evaluate", "absent.pfm", "truth.pfm"), "absent.pfm"),
        (("check", "absent"), "absent"),
    ],
)
def test_bad_input_is_one_line_and_code_2(run, arguments, message, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    code, _, err = run(*arguments)
    errors = [line for line in err.splitlines() if not line.endswith(": reading")]
    assert (code, len(errors)) == (2, 1)
    assert message in errors[0]
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("numbers", "message"), [(["1"], "Expected 2 values"), (["1", "a"], "two numbers, not 1 a")]
)
def test_a_pair_of_numbers_that_is_none_is_explained(run, numbers, message):
    code, _, err = run("estimate", "scene", "-o", "out", "--disparity-range", *numbers)
    assert code == 2
    assert message in err


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--disparity-range", 3, -3), "disparity_range (--disparity-range) needs minimum < max"),
        (("--layout", "lyto"), "layout is 'lyto'; did you mean 'lytro'?"),
        (("--flip", "x"), "flip is 'x'"),
        (("--max-disparity", 0), "max_disparity is 0"),
        (("--spacing", 0, 1), "spacing is 0 1"),
    ],
)
def test_wrong_options_are_explained_before_the_scene_is_read(run, options, message):
    code, _, err = run("estimate", "absent", "-o", "out", *options)
    assert (code, err.count("\n")) == (2, 1)
    assert message in err


@pytest.mark.parametrize("words", [["abc"], ["0.1", "abc"]])
def test_thresholds_that_are_no_numbers_are_explained(run, words):
    code, _, err = run("evaluate", "a.pfm", "b.pfm", "--thresholds", *words)
    assert code == 2
    assert f"pass one or more numbers, not {' '.join(words)}" in err


@pytest.mark.parametrize(
    "arguments",
    [
        ("convert", "a.pfm", "b.pfm", "--to", "foo"),
        ("convert", "a.pfm", "b.pfm", "--from", "foo"),
        ("estimate", "a", "-o", "b", "--warp", "foo"),
    ],
)
def test_none_is_not_among_the_choices(run, arguments):
    code, _, err = run(*arguments)
    assert code == 2
    assert "foo" in err
    assert "None" not in err


def test_reader_that_closes_the_pipe_is_no_error(scene):
    command = f"'{sys.executable}' -m occjax check '{scene}' | head -1"
    done = subprocess.run(command, shell=True, capture_output=True, text=True, check=True)
    assert done.stdout.startswith("scene: 9x9 views")
    assert done.stderr == ""


def test_weights_in_the_package_are_listed(run):
    code, out, _ = run("weights", "list")
    assert code == 0
    assert out.startswith("proposal: ")
    assert "sha256" in out


def test_help_names_the_models_that_can_run_and_the_list_all_others(run):
    _, out, _ = run("estimate", "--help")
    text = " ".join(out.replace("│", " ").split())
    assert "proposal or photometric; any other name from 'occjax weights list'" in text
    assert "cas_2_share" not in text
    _, out, _ = run("weights", "list")
    assert "models that have no weights: photometric\n" in out
    listed = out.splitlines()[-1].rpartition(": ")[2].split(", ")
    assert sorted([*listed, "proposal", "photometric"]) == sorted(PRESETS)


@pytest.mark.slow
def test_pool_is_rendered_and_explains_how_to_train_on_it(run, tmp_path):
    scenes = ["--scenes.image-size", 16, 16, "--scenes.grid", 3, 3, "--scenes.views", "all"]
    few = ["--scenes.walls", 1, "--scenes.sheets", 1, "--scenes.solids", 1]
    code, out, err = run("pool", tmp_path / "pool", "--count", 1, *scenes, *few)
    assert code == 0, err
    assert "1 light fields" in out
    assert f"--data.pools {tmp_path / 'pool'}" in out
    assert len(list((tmp_path / "pool").glob("*.npz"))) == 1
