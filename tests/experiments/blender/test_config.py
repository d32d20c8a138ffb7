import json

import pytest

from experiments.blender import STYLES, RenderConfig
from experiments.blender.kit import scene
from occjax.errors import InputError


def test_styles_match_the_renderer():
    assert ("mixed", *scene.STYLES) == STYLES


def test_values_are_unchanged_by_json():
    config = RenderConfig(seed=3, grid=(3, 5))
    assert json.loads(json.dumps(config.as_dict())) == config.as_dict()


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"seed": -1}, "seed"),
        ({"style": "attic"}, "still_life"),
        ({"image_size": (256, 4)}, "minimum is 8"),
        ({"grid": (0, 9)}, "grid"),
        ({"grid": (40, 40)}, "999"),
        ({"samples": 0}, "samples"),
    ],
)
def test_values_out_of_range_are_rejected(values, message):
    with pytest.raises(InputError, match=message):
        RenderConfig(**values)
