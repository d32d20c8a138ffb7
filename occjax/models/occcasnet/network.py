"""OccCasNet: the occlusion-aware cascade of cost volumes (Chao et al., 2023)."""

from __future__ import annotations

import flax.linen as nn
import jax
import jax.numpy as jnp
from jax.typing import DTypeLike
from jaxtyping import Array, Bool, Float

from occjax.errors import InputError
from occjax.lightfield import view_offsets
from occjax.models.occcasnet.aggregation import Aggregation, ViewAttention
from occjax.models.occcasnet.config import OccCasNetConfig
from occjax.models.occcasnet.features import FeatureNetwork
from occjax.models.occcasnet.stages import StageOutput, regress_stage
from occjax.ops import (
    coarse_volume,
    concatenate,
    group_correlation,
    mean_and_variance,
    occlusion_maps,
    occlusion_weights,
    refined_volume,
)
from occjax.ops.sampling import as_images
from occjax.ops.volume import Combine


def combine_function(config: OccCasNetConfig, index: int) -> Combine:
    """Return the function that combines the registered views into the volume of a stage."""
    return {
        "concatenate": concatenate,
        "statistics": mean_and_variance,
        "correlation": group_correlation(config.correlation_groups),
    }[config.stages[index].volume]


class OccCasNet(nn.Module):
    """Disparity of the centre view from a fixed grid of grey views.

    The network takes one light field without a batch axis. For a batch, vmap ``apply`` with
    ``axis_name="batch"``; in training BatchNorm synchronises over that axis. ``variables`` is a
    plain dict.

    Attributes:
        config: The cascade.
        dtype: Type of the convolutions (float32 or bfloat16). Parameters, sampling positions and
            regression stay float32.

    Example:
        >>> from occjax.models import preset
        >>> network = OccCasNet(preset("tiny"))
        >>> views = jnp.zeros((3, 3, 16, 16))
        >>> stages, variables = jax.jit(network.init_with_output)(jax.random.key(0), views)
        >>> [stage.disparity.shape for stage in stages]
        [(16, 16), (16, 16)]
    """

    config: OccCasNetConfig
    dtype: DTypeLike = jnp.float32

    def setup(self) -> None:
        """Create the feature network, and attention and aggregation of each stage."""
        config = self.config
        self.features = FeatureNetwork(config.features, dtype=self.dtype)
        stages = config.stages[:1] if config.shared_aggregation else config.stages
        self.attention = [
            ViewAttention(config.views[0], config.attention_width) if stage.attention else None
            for stage in stages
        ]
        self.aggregation = [Aggregation(stage.aggregation, dtype=self.dtype) for stage in stages]

    def __call__(
        self,
        views: Float[Array, "v u h w"],
        *,
        train: bool = False,
        candidates: Float[Array, " d"] | None = None,
        ground_truth: Float[Array, "h w"] | None = None,
        visibility: Bool[Array, "v u h w"] | None = None,
    ) -> tuple[StageOutput, ...]:
        """Estimate disparity, stage by stage.

        Args:
            views: ``[v, u, h, w]`` grey views in [0, 1].
            train: Whether BatchNorm uses batch statistics. Training needs
                ``mutable=["batch_stats"]`` and a vmapped axis named ``"batch"``.
            candidates: ``[d]`` disparities of the first stage instead of the configured ones. With
                trained weights, only shift them: the network has learned their interval.
            ground_truth: ``[h, w]`` disparity, needed if a stage has ``occlusion="ground_truth"``.
            visibility: ``[v, u, h, w]`` whether each view sees the point of the centre view, needed
                if a stage has ``occlusion="visibility"``.

        Returns:
            One :class:`StageOutput` per stage; the last one is the result.

        Raises:
            InputError: If the grid is not the configured one.
            ValueError: If the ground truth or the visibility is missing.
        """
        self.check_grid(views)
        features = self.extract(views, train=train)
        outputs: list[StageOutput] = []
        for index, stage in enumerate(self.config.stages):
            before = outputs[-1].disparity if outputs else None
            values = jnp.asarray(stage.candidates, jnp.float32)
            if before is None and candidates is not None:
                values = candidates
            maps = self.occlusion(index, views, before, ground_truth, visibility)
            volume = self.volume(index, features, values, before, maps)
            attention = self.attend(index, volume.mean((0, 1, 2), dtype=jnp.float32))
            scores = self.aggregate(index, volume, attention, train=train)
            outputs.append(regress_stage(scores, values, before, attention, maps))
        return tuple(outputs)

    def check_grid(self, views: Array) -> None:
        """Check that the views form the configured grid.

        Raises:
            InputError: If they do not.
        """
        as_images(views, "v u h w")
        if views.shape[:2] != self.config.views:
            v, u = self.config.views
            raise InputError(
                f"the network takes grey views [{v}, {u}, H, W], not {list(views.shape)}"
            )

    def extract(
        self, views: Float[Array, "v u h w"], *, train: bool = False
    ) -> Float[Array, "v u h w c"]:
        """Compute the features of every view.

        Args:
            views: ``[v, u, h, w]`` grey views in [0, 1]; any number of views.
            train: Whether BatchNorm uses batch statistics.

        Returns:
            ``[v, u, h, w, c]`` features.
        """
        v, u, h, w = views.shape
        images = views.reshape(v * u, h, w, 1)
        # By default, statistics are pooled over all views. The running averages, which inference
        # uses, then average the same statistics that training normalises by. The published code
        # calls the network once per view. It normalises each view by its own statistics and updates
        # the averages V * U times a step, so that they depend on the last few steps only.
        # "per_view" reproduces the published code.
        if train and self.config.feature_statistics == "per_view":
            features = self._extract_view_by_view(images)
        else:
            features = self.features(images, train=train)
        return features.reshape(v, u, h, w, -1)

    def _extract_view_by_view(self, images: Float[Array, "n h w 1"]) -> Float[Array, "n h w c"]:
        def one_view(network, carry, image):
            return carry, network(image[None], train=True)[0]

        scan = nn.scan(one_view, variable_broadcast="params", variable_carry="batch_stats")
        return scan(self.features, None, images)[1]

    def occlusion(
        self,
        index: int,
        views: Float[Array, "v u h w"],
        before: Float[Array, "h w"] | None,
        ground_truth: Float[Array, "h w"] | None = None,
        visibility: Bool[Array, "v u h w"] | None = None,
    ) -> Float[Array, "v u h w"] | None:
        """Compute the occlusion maps of a stage (eqs. 4 and 5).

        Args:
            index: Index of the stage.
            views: ``[v, u, h, w]`` grey views in [0, 1].
            before: ``[h, w]`` disparity of the stage before.
            ground_truth: ``[h, w]`` disparity.
            visibility: ``[v, u, h, w]`` whether each view sees the point of the centre view.

        Returns:
            ``[v, u, h, w]`` in [0, 1], or None if the stage uses no occlusion maps.

        Raises:
            ValueError: If the stage needs the ground truth or the visibility and it is missing.
        """
        source = self.config.stages[index].occlusion
        if source == "none":
            return None
        if source == "visibility":
            if visibility is None:
                raise ValueError("this network needs the visibility of every view; pass it")
            return 1.0 - visibility.astype(jnp.float32)
        disparity = ground_truth if source == "ground_truth" else before
        if disparity is None:
            raise ValueError("this network computes occlusion from the ground truth; pass it")
        return occlusion_maps(views[..., None], disparity, offsets=self.warp_offsets())

    def volume(
        self,
        index: int,
        features: Float[Array, "v u h w c"],
        candidates: Float[Array, " d"],
        before: Float[Array, "h w"] | None,
        maps: Float[Array, "v u h w"] | None,
    ) -> Float[Array, "d h w k"]:
        """Build the cost volume of a stage: coarse for the first stage, refined for the others."""
        weights = None if maps is None else occlusion_weights(maps)
        combine = combine_function(self.config, index)
        if before is None:
            return coarse_volume(features, candidates, weights=weights, combine=combine)
        offsets = self.warp_offsets()
        return refined_volume(
            features, before, candidates, weights=weights, offsets=offsets, combine=combine
        )

    def warp_offsets(self) -> Float[Array, "v u 2"]:
        """Return the offsets of the views for the per-pixel warp, transposed if configured."""
        offsets = jnp.asarray(view_offsets(*self.config.views))
        return offsets[..., ::-1] if self.config.warp == "transposed" else offsets

    def attend(self, index: int, mean: Float[Array, " k"]) -> Float[Array, "v u"] | None:
        """Compute the weight of each view from the mean over a stage's volume, if configured."""
        attention = self.attention[self.config.part_index(index)]
        return None if attention is None else attention(mean)

    def aggregate(
        self,
        index: int,
        volume: Float[Array, "d h w k"],
        attention: Float[Array, "v u"] | None,
        *,
        train: bool = False,
    ) -> Float[Array, "d h w"]:
        """Aggregate a stage's volume, weighted by attention, into scores of the candidates.

        Args:
            index: Index of the stage.
            volume: ``[d, h, w, k]`` cost volume.
            attention: ``[v, u]`` weight of each view; None for no weights.
            train: Whether BatchNorm uses batch statistics.

        Returns:
            ``[d, h, w]`` scores; a higher score means a more likely candidate.
        """
        if attention is not None:
            per_channel = jnp.repeat(attention.reshape(-1), self.config.features.channels)
            volume = volume * per_channel.astype(volume.dtype)[None, None, None]
        return self.aggregation[self.config.part_index(index)](volume, train=train)


def variable_shapes(config: OccCasNetConfig) -> dict:
    """Return shapes and types of the network's variables without computing any."""
    views = jax.ShapeDtypeStruct((*config.views, 16, 16), jnp.float32)
    known = {  # some networks take them
        "ground_truth": jax.ShapeDtypeStruct((16, 16), jnp.float32),
        "visibility": jax.ShapeDtypeStruct(views.shape, jnp.bool_),
    }
    return jax.eval_shape(OccCasNet(config).init, jax.random.key(0), views, **known)
