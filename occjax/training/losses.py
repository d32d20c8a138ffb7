"""What training minimises: errors of disparity, of probabilities and of occlusion weights.

Each error is a pure function of one light field that gives a value per pixel; means are taken over
the pixels of a batch that count.
"""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp
import optax
from jaxtyping import Array, Bool, Float

from occjax.data.samples import Sample
from occjax.errors import InputError
from occjax.models.stages import StageOutput
from occjax.ops import occlusion_weights
from occjax.training.config import LossConfig, Penalty
from occjax.training.prepared import PreparedSample

WEIGHT_MARGIN = 1e-4
"""Occlusion weights are kept this far from 0 and 1, where their cross-entropy is infinite."""


RIGHT = (0.04, 0.12)
"""Error up to which a proposal is right, and from which on it is wrong, pixels per view step."""


class Total(NamedTuple):
    """A sum and the number of its terms; totals of several light fields can be added.

    Attributes:
        value: ``[]`` sum.
        terms: ``[]`` their number, each counted by its weight.
    """

    value: Float[Array, "*b"]
    terms: Float[Array, "*b"]


def cascade_loss(
    outputs: tuple[StageOutput, ...], batch: Sample | PreparedSample, config: LossConfig
) -> tuple[Float[Array, ""], dict[str, Float[Array, ""]]]:
    """Loss of a batch: the weighted sum of every stage's errors (eq. 11 and its extensions).

    Args:
        outputs: Of the cascade, with a batch axis on every field.
        batch: The examples.
        config: Which errors, and how much each weighs.

    Returns:
        The loss, and each error's mean over the pixels that count: ``disparity_0``,
        ``distribution_0``, ``occlusion_1`` and so on, one for each stage that has it. A mean over
        no pixels is 0.

    Raises:
        InputError: If there is another number of stage weights than of outputs.
    """
    weights = config.stage_weights or (1.0,) * len(outputs)
    if len(weights) != len(outputs):
        raise InputError(
            f"loss.stage_weights has {len(weights)} weights but the network {len(outputs)} "
            "outputs; pass one for each"
        )

    def totals_of_one(outputs, sample):
        return [
            stage_totals(output, outputs[index - 1] if index else None, sample, config)
            for index, output in enumerate(outputs)
        ]

    totals = jax.vmap(totals_of_one)(outputs, batch)
    importance = {
        "disparity": 1.0,
        "distribution": config.distribution,
        "occlusion": config.occlusion,
    }
    loss, errors = jnp.zeros(()), {}
    for index, (weight, stage) in enumerate(zip(weights, totals, strict=True)):
        for name, total in stage.items():
            mean = total.value.sum() / jnp.maximum(total.terms.sum(), 1.0)
            loss = loss + weight * importance[name] * mean
            errors[f"{name}_{index}"] = mean
    return loss, errors


def stage_totals(
    output: StageOutput,
    before: StageOutput | None,
    sample: Sample | PreparedSample,
    config: LossConfig,
) -> dict[str, Total]:
    """Errors of one stage on one light field, summed over the pixels that count.

    Args:
        output: Of the stage.
        before: Of the stage before, None for the first.
        sample: The light field.
        config: Which errors.

    Returns:
        Totals by the name of the error; errors of weight 0 are left out.
    """
    counted = inside_border(sample.valid, config.border).astype(jnp.float32)
    # An unknown disparity may be NaN, which no factor of zero removes from a gradient.
    truth = jnp.where(sample.valid, sample.disparity, 0.0)
    error = penalty(output.disparity - truth, kind=config.penalty, width=config.width)
    probabilities, candidates = output.probabilities, output.candidates
    relative = truth
    if before is not None:
        relative = truth - jax.lax.stop_gradient(before.disparity)
    chooses = False
    if candidates is not None and candidates.ndim == 3:
        chooses = True
        counted *= choice_weight(candidates, relative, settled=config.settled)
    totals = {"disparity": total(error, counted)}
    if config.distribution > 0.0 and probabilities is not None and candidates is not None:
        if chooses:
            entropy = choice_error(probabilities, candidates, relative)
        else:
            entropy, covered = distribution_error(probabilities, candidates, relative)
            counted = jnp.where(covered, counted, 0.0)
        totals["distribution"] = total(entropy, counted)
    if config.occlusion > 0.0 and output.occlusion is not None and isinstance(sample, Sample):
        entropy = visibility_error(occlusion_weights(output.occlusion), sample.visibility)
        totals["occlusion"] = total(entropy, inside_border(sample.valid, config.border))
    return totals


def rightness(proposed: Float[Array, "k h w"], truth: Float[Array, "h w"]) -> Float[Array, "k h w"]:
    """How right each proposal is: 1 up to an error of 0.04, 0 from 0.12 on.

    Which of two right proposals is nearer is not for a choice to tell, but for what follows it.

    Args:
        proposed: ``[k, h, w]`` disparities.
        truth: ``[h, w]`` in the same terms.

    Returns:
        ``[k, h, w]`` in [0, 1].

    Example:
        >>> errors = jnp.array([0.0, 0.08, 0.2]).reshape(3, 1, 1)
        >>> rightness(errors, jnp.zeros((1, 1)))[:, 0, 0].round(2).tolist()
        [1.0, 0.5, 0.0]
    """
    right, wrong = RIGHT
    return jnp.clip((wrong - jnp.abs(proposed - truth[None])) / (wrong - right), 0.0, 1.0)


def choice_weight(
    proposed: Float[Array, "k h w"], truth: Float[Array, "h w"], *, settled: float
) -> Float[Array, "h w"]:
    """How much a pixel counts in learning to choose.

    Where no proposal is right, whatever is chosen is wrong: to be trained on it would only teach
    that no proposal is to be trusted. Where all but one of them are right, there is hardly a
    choice.

    Args:
        proposed: ``[k, h, w]`` disparities.
        truth: ``[h, w]`` in the same terms.
        settled: Weight of pixels for which at most one proposal is wrong.

    Returns:
        ``[h, w]``: 0, ``settled`` or 1.

    Example:
        >>> proposed = jnp.array([[0.0, 0.0, 5.0], [0.0, 1.0, 5.0], [0.0, 1.0, 5.0]])[:, None]
        >>> choice_weight(proposed, jnp.zeros((1, 3)), settled=0.2).round(1).tolist()
        [[0.20000000298023224, 1.0, 0.0]]
    """
    right = jax.lax.stop_gradient(rightness(proposed, truth)) > 0.5
    wrong = (~right).sum(0, dtype=jnp.float32)
    return jnp.where(right.any(0), jnp.where(wrong <= 1.0, settled, 1.0), 0.0)


def penalty(
    error: Float[Array, "*shape"], *, kind: Penalty = "l1", width: float = 0.02
) -> Float[Array, "*shape"]:
    """Penalty of an error in disparity.

    * ``"l1"``: ``|e|``;
    * ``"huber"``: ``e^2 / (2 width)`` up to the width, ``|e| - width / 2`` beyond, also known as
      smooth L1: errors below the width hardly count;
    * ``"sharp"``: ``|e| + 5 width log(1 + |e| / width)``, six times as steep at zero: errors below
      the width count most, as they do in BadPix;
    * ``"log"``: the second term of ``"sharp"`` alone: errors far beyond the width count as bad and
      little more. Where nothing shows the disparity, no step can mend an error of several pixels,
      whose gradient then is noise.

    Args:
        error: Estimate minus truth, pixels per view step.
        kind: Which.
        width: Of the part about zero, pixels per view step.

    Returns:
        Same shape.

    Example:
        >>> penalty(jnp.array([-0.5, 2.0]), kind="huber", width=1.0).tolist()
        [0.125, 1.5]
    """
    size = jnp.abs(error)
    if kind == "l1":
        return size
    if kind == "huber":
        return optax.huber_loss(error, delta=width) / width
    steep = 5.0 * width * jnp.log1p(size / width)
    return size + steep if kind == "sharp" else steep


def distribution_error(
    probabilities: Float[Array, "d h w"],
    candidates: Float[Array, " d"],
    truth: Float[Array, "h w"],
) -> tuple[Float[Array, "h w"], Bool[Array, "h w"]]:
    """Cross-entropy between a stage's probabilities and the true disparity of each pixel.

    The truth is a distribution over its two neighbouring candidates, whose expectation it is.

    Args:
        probabilities: ``[d, h, w]`` of the candidates.
        candidates: ``[d]``, ascending.
        truth: ``[h, w]`` in the same terms as the candidates: for a refined stage, relative to the
            disparity of the stage before.

    Returns:
        ``[h, w]`` cross-entropy in nats, and ``[h, w]`` whether the candidates cover the truth;
        elsewhere the cross-entropy means nothing.

    Example:
        >>> even = jnp.full((2, 1, 1), 0.5)
        >>> entropy, covered = distribution_error(even, jnp.array([0.0, 1.0]), jnp.array([[0.3]]))
        >>> round(float(entropy[0, 0]), 3), bool(covered[0, 0])
        (0.693, True)
    """
    candidates = jax.lax.stop_gradient(candidates)
    below = jnp.concatenate([2.0 * candidates[:1] - candidates[1:2], candidates[:-1]])
    above = jnp.concatenate([candidates[1:], 2.0 * candidates[-1:] - candidates[-2:-1]])

    def per_candidate(values):
        return values[:, None, None]

    rising = (truth[None] - per_candidate(below)) / per_candidate(candidates - below)
    falling = (per_candidate(above) - truth[None]) / per_candidate(above - candidates)
    share = jnp.clip(jnp.minimum(rising, falling), 0.0, 1.0)
    # A probability that underflows to zero still has a gradient through the softmax above it at
    # any positive value, so the smallest one is the right floor.
    logarithm = jnp.log(jnp.maximum(probabilities, jnp.finfo(probabilities.dtype).tiny))
    entropy = -(share * logarithm).sum(0)
    return entropy, (truth >= candidates[0]) & (truth <= candidates[-1])


def choice_error(
    probabilities: Float[Array, "k h w"],
    proposed: Float[Array, "k h w"],
    truth: Float[Array, "h w"],
) -> Float[Array, "h w"]:
    """Cross-entropy of choosing a right proposal, where each pixel has its own.

    Several proposals may be about the same, as those of a pixel's neighbours on one surface are:
    it does not matter which of them is chosen.

    Args:
        probabilities: ``[k, h, w]`` of the proposals.
        proposed: ``[k, h, w]``, in any order.
        truth: ``[h, w]`` in the same terms.

    Returns:
        ``[h, w]`` in nats; means nothing where no proposal is right.

    Example:
        >>> thirds = jnp.full((3, 1, 1), 1 / 3)
        >>> proposed = jnp.array([0.2, 0.2, 0.9]).reshape(3, 1, 1)
        >>> round(float(choice_error(thirds, proposed, jnp.array([[0.2]]))[0, 0]), 3)  # -log(2 / 3)
        0.405
    """
    right = jax.lax.stop_gradient(rightness(proposed, truth))
    # What no proposal could reach is no fault of the choice.
    chosen = (probabilities * right).sum(0) / jnp.maximum(right.max(0), 1e-3)
    return -jnp.log(jnp.maximum(chosen, 1e-6))


def visibility_error(
    weights: Float[Array, "v u h w"], visibility: Bool[Array, "v u h w"]
) -> Float[Array, "h w"]:
    """Cross-entropy between occlusion weights and exact visibility, the mean over the views.

    Args:
        weights: ``[v, u, h, w]`` in [0, 1].
        visibility: ``[v, u, h, w]`` whether each view sees the point.

    Returns:
        ``[h, w]`` in nats.

    Example:
        >>> seen = jnp.array([True, False]).reshape(1, 2, 1, 1)
        >>> round(float(visibility_error(jnp.full((1, 2, 1, 1), 0.5), seen)[0, 0]), 3)
        0.693
    """
    weights = jnp.clip(weights, WEIGHT_MARGIN, 1.0 - WEIGHT_MARGIN)
    return -jnp.log(jnp.where(visibility, weights, 1.0 - weights)).mean((0, 1))


def inside_border(valid: Bool[Array, "h w"], border: int) -> Bool[Array, "h w"]:
    """The valid pixels that are at least ``border`` pixels away from each side."""
    h, w = valid.shape
    rows, columns = jnp.arange(h)[:, None], jnp.arange(w)[None]
    inside = (rows >= border) & (rows < h - border) & (columns >= border) & (columns < w - border)
    return valid & inside


def total(values: Float[Array, "h w"], weights: Float[Array, "h w"] | Bool[Array, "h w"]) -> Total:
    """Weighted sum of the values of the pixels that count, and the sum of the weights."""
    weights = weights.astype(values.dtype)
    return Total(jnp.where(weights > 0.0, values * weights, 0.0).sum(), weights.sum())
