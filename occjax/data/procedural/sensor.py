"""Camera defects, added to rendered views."""

from __future__ import annotations

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from occjax.data.procedural.config import Defects
from occjax.data.procedural.draws import Draws, Key


def add_camera_defects(
    key: Key, views: Float[Array, "n h w"], offsets: Float[Array, "n 2"], defects: Defects
) -> Float[Array, "n h w"]:
    """Add camera defects to rendered views.

    The order is: exposure (a random mean brightness), vignetting, blur like that of
    demosaicing, sensor noise, gamma, clipping, rounding to 8 bits.

    Args:
        key: Random key.
        views: ``[n, h, w]`` brightness, at least 0, any scale.
        offsets: ``[n, 2]`` offset of each view from the centre view, in view steps.
        defects: Probability of each defect.

    Returns:
        ``[n, h, w]`` grey views in [0, 1].
    """
    number_key, noise_key = jax.random.split(key)
    draws = Draws(number_key)
    views = views * (draws.log_uniform(0.15, 0.6) / (jnp.mean(views) + 1e-3))

    views = views * _vignetting(draws, views.shape, offsets, draws.chance(defects.vignetting))
    side = draws.choose(defects.blur, draws.uniform(0.03, 0.25))
    padded = jnp.pad(views, ((0, 0), (1, 1), (1, 1)), mode="edge")
    rows = padded[:, 1:-1] * (1.0 - 2.0 * side) + (padded[:, :-2] + padded[:, 2:]) * side
    views = rows[..., 1:-1] * (1.0 - 2.0 * side) + (rows[..., :-2] + rows[..., 2:]) * side

    amount = draws.choose(defects.noise, draws.log_uniform(0.001, 0.03))
    shot, read = amount * draws.unit(), amount * draws.unit()
    deviation = jnp.sqrt(shot**2 * jnp.maximum(views, 0.0) + read**2)
    views = views + deviation * jax.random.normal(noise_key, views.shape)

    gamma = draws.choose(defects.gamma, draws.log_uniform(0.5, 1.6), 1.0)
    views = jnp.clip(views, 0.0, 1.0)
    views = jnp.exp(gamma * jnp.log(jnp.maximum(views, 1e-6)))
    whole = jnp.round(views * 255.0) / 255.0
    return jnp.where(draws.chance(defects.quantisation), whole, views)


def _vignetting(
    draws: Draws, shape: tuple[int, ...], offsets: Float[Array, "n 2"], present: Bool[Array, ""]
) -> Float[Array, "n h w"]:
    """Return the brightness factor: darker image corners, and darker views at the grid's border."""
    _, h, w = shape
    side = 0.5 * max(h, w)
    y = (jnp.arange(h, dtype=jnp.float32) - 0.5 * (h - 1)) / side - draws.uniform(-0.7, 0.7)
    x = (jnp.arange(w, dtype=jnp.float32) - 0.5 * (w - 1)) / side - draws.uniform(-0.7, 0.7)
    step = offsets / jnp.maximum(jnp.max(jnp.abs(offsets)), 1.0)
    # The dark corners move with the view, which looks through another part of the main lens.
    drift = draws.uniform(0.0, 0.6)
    down = jnp.square(y[None] + drift * step[:, :1])[:, :, None]
    across = jnp.square(x[None] + drift * step[:, 1:])[:, None, :]
    corner = draws.uniform(0.0, 0.25) * (down + across)
    border = draws.uniform(0.0, 0.3) * jnp.sum(step**2, axis=-1)[:, None, None]
    return jnp.where(present, jnp.maximum(1.0 - corner - border, 0.1), 1.0)
