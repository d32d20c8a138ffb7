import json

import pytest

from occjax.errors import InputError
from occjax.render import STYLES, RenderConfig
from occjax.render.blender import scene


def test_styles_are_those_that_the_renderer_has():
    assert ("mixed", *scene.STYLES) == STYLES


def test_values_survive_json():
    config = RenderConfig(seed=3, grid=(3, 5))
    assert json.loads(json.dumps(config.as_dict())) == config.as_dict()


def test_centre_view_is_that_of_the_library():
    assert RenderConfig().centre == 40
    assert RenderConfig(grid=(2, 4)).centre == 6  # row 1, column 2


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"seed": -1}, "seed"),
        ({"style": "attic"}, "still_life"),
        ({"image_size": (256, 4)}, "8 pixels"),
        ({"grid": (0, 9)}, "grid"),
        ({"grid": (40, 40)}, "999"),
        ({"samples": 0}, "samples"),
    ],
)
def test_values_that_cannot_be_rendered_are_refused(values, message):
    with pytest.raises(InputError, match=message):
        RenderConfig(**values)
