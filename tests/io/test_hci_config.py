"""``parameters.cfg``, where no light field is at hand."""

import pytest

from occjax.errors import InputError
from occjax.io.hci_config import read_hci_config
from tests.io.files import CONFIG

HEIGHT = "image_resolution_x_px = 24\nimage_resolution_y_px = 20"


def test_the_size_of_the_views_is_known_if_both_sides_are(tmp_path):
    path = tmp_path / "parameters.cfg"
    path.write_text(CONFIG)
    assert read_hci_config(path).image_size is None
    path.write_text(CONFIG.replace("image_resolution_x_px = 24", HEIGHT))
    assert read_hci_config(path).image_size == (20, 24)


def test_a_size_that_is_none_is_named(tmp_path):
    path = tmp_path / "parameters.cfg"
    path.write_text(CONFIG.replace("image_resolution_x_px = 24", "image_resolution_x_px = 2.5"))
    with pytest.raises(InputError, match=r"image_resolution_x_px in \[intrinsics\] is 2\.5"):
        read_hci_config(path)
