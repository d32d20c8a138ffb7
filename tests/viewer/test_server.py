"""The server: what it shows, and that it leaves nothing behind."""

import os
import socket
import threading
from pathlib import Path

import numpy as np
import pytest

from occjax.errors import InputError
from occjax.viewer import ViewedResult, ViewedScene, Viewer, ViewerConfig, open_viewer
from occjax.viewer.drawing import epipolar_picture
from occjax.viewer.pixel import epipolar_image


@pytest.fixture
def viewer(two_results, capsys):
    with Viewer(two_results, config=ViewerConfig(blink_seconds=0.01)) as viewer:
        viewer.wait_until_idle()
        yield viewer
    assert capsys.readouterr() == ("", "")  # a task that fails prints its traceback


def test_the_numbers_of_the_picked_pixel_are_those_of_the_selected_result(viewer):
    viewer.select_pixel(3, 30)
    viewer.wait_until_idle()
    assert "0.500 pixels per view step" in viewer.pixel.numbers.content
    viewer.select_result(1)
    viewer.wait_until_idle()
    assert (viewer.pixel.y.value, viewer.pixel.x.value) == (3, 30)
    for text in ("1.500 pixels per view step", "+1.000", "exact | 0.500"):
        assert text in viewer.pixel.numbers.content
    viewer.select_pixel(99, -5)
    viewer.wait_until_idle()
    assert (viewer.pixel.y.value, viewer.pixel.x.value) == (23, 0)


def test_the_epipolar_plane_image_is_that_of_the_chosen_line(viewer, two_results):
    viewer.select_pixel(10, 12)
    field = two_results.light_field
    for line, picked in (("row", 12), ("column", 10)):
        viewer.pixel.line.value = line
        viewer.wait_until_idle()
        epi = epipolar_image(field, 10, 12, line, radius_px=ViewerConfig().epi_radius_px)
        np.testing.assert_array_equal(viewer.pixel.epi.image, epipolar_picture(epi, picked, 0.5))


def test_the_confidence_threshold_hides_points(viewer):
    viewer.cloud.hide_flying.value = False
    viewer.cloud.threshold.value = 0.5
    viewer.wait_until_idle()
    confidence = np.linspace(0.0, 1.0, 32)
    np.testing.assert_array_equal(viewer.cloud.visible(0), np.tile(confidence >= 0.5, (24, 1)))


def test_blinking_shows_the_results_in_turn(viewer):
    seen, shown = set(), threading.Event()

    @viewer.comparison.result.on_update
    def _(_):
        seen.add(viewer.comparison.result.value)
        if len(seen) == 2:
            shown.set()

    viewer.comparison.blink.value = True
    assert shown.wait(10.0)


def test_the_scores_are_those_of_the_results(viewer):
    table = viewer.comparison.scores.content
    assert "| exact | 0.00 % | 0.000 |" in table
    assert "| wrong | 50.00 % | 50.000 |" in table


def test_a_result_without_views_has_a_cloud_and_numbers_only():
    scene = ViewedScene((ViewedResult("map", np.zeros((8, 10), np.float32)),))
    with Viewer(scene) as viewer:
        viewer.wait_until_idle()
        assert viewer.panels == [viewer.cloud, viewer.pixel]
        assert viewer.cloud.mode.options == ("disparity",)
        assert "0.000 pixels per view step" in viewer.pixel.numbers.content


def test_only_this_computer_can_reach_the_page_and_a_taken_port_is_refused(two_results):
    with (
        socket.create_server(("127.0.0.1", 0)) as other,
        pytest.raises(InputError, match="pass another --port"),
    ):
        Viewer(two_results, port=other.getsockname()[1])
    with Viewer(two_results) as viewer:
        assert viewer.url == f"http://127.0.0.1:{viewer.port}"
        with pytest.raises(OSError, match="refused"):
            socket.create_connection(("127.0.0.2", viewer.port))


@pytest.mark.slow
def test_fifty_viewers_leave_no_thread_process_port_or_file_behind(two_results):
    def children():
        return Path(f"/proc/self/task/{threading.main_thread().native_id}/children").read_text()

    def files():
        return len(os.listdir("/proc/self/fd"))

    ports = []
    with open_viewer(two_results, open_browser=False) as viewer:
        viewer.wait_until_idle()  # JAX starts its own threads at the first computation
    threads, children_before, files_before = set(threading.enumerate()), children(), files()
    for _ in range(50):
        with open_viewer(two_results, open_browser=False) as viewer:
            viewer.wait_until_idle()
            ports.append(viewer.port)
    assert set(threading.enumerate()) <= threads  # a thread of another test may have ended
    assert (children(), files()) == (children_before, files_before)
    for port in ports:
        with socket.create_server(("127.0.0.1", port)):
            pass
