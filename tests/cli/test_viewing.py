"""The command ``view``."""

import numpy as np

from occjax.viewer.server import Viewer


def test_the_command_prints_the_address_and_the_tunnel(run, tmp_path, monkeypatch):
    np.save(tmp_path / "disparity.npy", np.zeros((8, 10), np.float32))
    monkeypatch.setattr(Viewer, "wait", Viewer.wait_until_idle)
    code, out, err = run("view", tmp_path, "--no-open")
    assert code == 0
    assert "the page has no views" in err
    port = out.splitlines()[0].removeprefix("http://127.0.0.1:")
    assert f"ssh -L {port}:localhost:{port} " in out


def test_wrong_arguments_are_refused_before_anything_is_read(run, tmp_path):
    code, _, err = run("view", tmp_path, "--port", 99999)
    assert code == 2
    assert "pass 1 to 65535" in err
    code, _, err = run("view", tmp_path, "--order", "uv")
    assert code == 2
    assert "need --scene" in err
    code, _, err = run("view")
    assert code == 2
    assert "at least one folder" in err
