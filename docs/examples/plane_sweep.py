"""A third model, plane sweep: ``occjax.estimate(light_field, model=PlaneSweep())`` runs it."""

from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np

from occjax import Estimate, ops
from occjax.estimators import ModelInputs
from occjax.lightfield import centre_index


def absolute_difference(views, weights):
    """Compute the mean absolute difference of the registered views to the centre view."""
    centre = views[centre_index(views.shape[:2])]
    return jnp.abs(views - centre[None, None]).mean((0, 1, 4))


@dataclass(frozen=True)
class PlaneSweep:
    """The disparity at which the views, shifted as a whole, agree best."""

    steps: int = 33
    temperature: float = 0.01
    name: str = "plane sweep"

    def prepare(self, light_field, disparity_range):
        """Convert the light field to arrays."""
        low, high = disparity_range or light_field.disparity_range or (-2.0, 2.0)
        candidates = np.linspace(low, high, self.steps, dtype=np.float32)
        arguments = (candidates, light_field.positions)
        return ModelInputs(None, light_field.floating(), arguments, (low, high))

    def run(self, variables, views, candidates, offsets):
        """Compute disparity and confidence; a pure function, compiled once per shape."""
        costs = ops.coarse_volume(
            views, candidates, offsets=offsets, combine=absolute_difference, streamed=True
        )
        reading = ops.confidence(jax.nn.softmax(-costs / self.temperature, axis=0), candidates)
        return {
            "disparity": ops.winner_takes_all(costs, candidates),
            "confidence": reading.certainty(self.steps),
            "standard_deviation": reading.standard_deviation,
        }

    def finish(self, inputs, outputs):
        """Name the model and the range of the maps."""
        return Estimate(**outputs, disparity_range=inputs.disparity_range, model=self.name)
