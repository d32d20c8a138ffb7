"""OccCasNet: the occlusion-aware cascade of cost volumes."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

import flax.linen as nn
import jax
import jax.numpy as jnp
from jax.typing import DTypeLike
from jaxtyping import Array, Float

from occjax.errors import InputError
from occjax.models.aggregation import Aggregation, ViewAttention
from occjax.models.config import FeatureConfig, NetworkConfig, Residual, of_kind
from occjax.models.features import FeatureNetwork
from occjax.models.proposals import Proposals
from occjax.models.sectors import SectorCascade
from occjax.models.stages import StageOutput, stage_output
from occjax.ops import (
    coarse_volume,
    concatenate,
    mean_and_variance,
    occlusion_maps,
    occlusion_weights,
    refined_volume,
    view_offsets,
)
from occjax.ops.sampling import as_images
from occjax.ops.volume import Combine

COMBINED: Mapping[str, Combine] = MappingProxyType(
    {"concatenate": concatenate, "statistics": mean_and_variance}
)
"""What becomes of the registered views, by the kind of volume."""


class OccCasNet(nn.Module):
    """Disparity of the centre view from a grid of grey views.

    One light field, no batch axis: vmap ``apply`` over a batch with ``axis_name="batch"``, over
    which BatchNorm then synchronises while training. ``variables`` is a plain dict.

    Attributes:
        config: The cascade.
        dtype: Type of the convolutions (float32 or bfloat16); parameters, sampling positions and
            regression stay float32.

    Example:
        >>> from occjax.models import preset
        >>> network = OccCasNet(preset("tiny"))
        >>> views = jnp.zeros((3, 3, 16, 16))
        >>> variables = jax.jit(network.init)(jax.random.key(0), views)
        >>> [stage.disparity.shape for stage in network.apply(variables, views)]
        [(16, 16), (16, 16)]
    """

    config: NetworkConfig
    dtype: DTypeLike = jnp.float32

    def setup(self) -> None:
        """Name the parts."""
        config = self.config
        if config.views is None:
            self.sectors = SectorCascade(config, dtype=self.dtype)
            return
        self.features = FeatureNetwork(of_kind(config.features, FeatureConfig), dtype=self.dtype)
        stages = config.stages[:1] if config.shared_aggregation else config.stages
        self.attention = [
            ViewAttention(config.views[0], config.attention_width) if stage.attention else None
            for stage in stages
        ]
        self.aggregation = [
            Aggregation(of_kind(stage.aggregation, Residual), dtype=self.dtype) for stage in stages
        ]

    def __call__(
        self,
        views: Float[Array, "v u h w"],
        *,
        train: bool = False,
        candidates: Float[Array, " d"] | None = None,
        ground_truth: Float[Array, "h w"] | None = None,
        offsets: Float[Array, "v u 2"] | None = None,
    ) -> tuple[StageOutput, ...]:
        """Estimate disparity, stage by stage.

        Args:
            views: ``[v, u, h, w]`` grey views in [0, 1]; the centre view is ``[v // 2, u // 2]``.
            train: Normalise by batch statistics; needs ``mutable=["batch_stats"]`` and a vmapped
                axis named ``"batch"``.
            candidates: ``[d]`` disparities of the first stage in place of the configured ones. With
                trained weights only their offset is free: a network knows its interval.
            ground_truth: ``[h, w]`` disparity, needed where a stage's occlusion is
                ``"ground_truth"``.
            offsets: ``[v, u, 2]`` offset ``(row, column)`` of each view from the centre view, for a
                network of any arrangement of views; a regular grid by default. Without
                ``candidates`` the configured ones are scaled to the largest offset.

        Returns:
            One :class:`StageOutput` per stage, and for a network of any arrangement one more; the
            last is the answer.

        Raises:
            InputError: If the grid is not the configured one.
            ValueError: If the ground truth is missing.
        """
        self.check_grid(views)
        if self.config.views is None:
            if offsets is None:
                offsets = view_offsets(*views.shape[:2])
            return self.sectors(views, offsets, candidates)
        features = self.extract(views, train=train)
        outputs: list[StageOutput] = []
        for index, stage in enumerate(self.config.stages):
            before = outputs[-1].disparity if outputs else None
            values = jnp.asarray(stage.candidates, jnp.float32)
            if before is None and candidates is not None:
                values = candidates
            maps = self.occlusion(index, views, before, ground_truth)
            volume = self.volume(index, features, values, before, maps)
            attention = self.attend(index, volume.mean((0, 1, 2), dtype=jnp.float32))
            scores = self.aggregate(index, volume, attention, train=train)
            outputs.append(stage_output(scores, values, before, attention, maps))
        return tuple(outputs)

    def propose(self, views: Float[Array, "v u h w"], offsets: Float[Array, "v u 2"]) -> Proposals:
        """What a network of any arrangement of views chooses from, see :class:`SectorCascade`."""
        return self.sectors.propose(views, offsets)

    def choose(self, proposals: Proposals) -> StageOutput:
        """The choice of such a network, the only part of it that is learned."""
        return self.sectors.choose(proposals)

    def check_grid(self, views: Array) -> None:
        """Refuse views of another grid than the configured one.

        Raises:
            InputError: With the two grids in its message.
        """
        as_images(views, "v u h w")
        if self.config.views is not None and views.shape[:2] != self.config.views:
            v, u = self.config.views
            raise InputError(
                f"the network takes grey views [{v}, {u}, H, W], not {list(views.shape)}"
            )

    def extract(
        self, views: Float[Array, "v u h w"], *, train: bool = False
    ) -> Float[Array, "v u h w c"]:
        """Features of every view.

        Args:
            views: ``[v, u, h, w]`` grey views in [0, 1]; any number of them.
            train: Normalise by batch statistics.

        Returns:
            ``[v, u, h, w, c]``.
        """
        v, u, h, w = views.shape
        images = views.reshape(v * u, h, w, 1)
        # Pooling over views is the default because the running averages, which inference uses, are
        # then averages of exactly what training normalised by, from V * U times as many samples.
        # The published code calls the network once per view: each view is normalised by its own
        # statistics and each call updates the averages, V * U times a step, so that they follow the
        # last few steps only. "per_view" does just that.
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
    ) -> Float[Array, "v u h w"] | None:
        """Occlusion maps of a stage, or None if it uses none (eqs. 4 and 5).

        Args:
            index: Number of the stage.
            views: ``[v, u, h, w]`` grey views in [0, 1].
            before: ``[h, w]`` disparity of the stage before.
            ground_truth: ``[h, w]`` disparity.

        Returns:
            ``[v, u, h, w]`` in [0, 1].

        Raises:
            ValueError: If the stage needs a ground truth and there is none.
        """
        source = self.config.stages[index].occlusion
        if source == "none":
            return None
        disparity = ground_truth if source == "ground_truth" else before
        if disparity is None:
            raise ValueError("this network takes its occlusion maps from the ground truth; pass it")
        return occlusion_maps(views[..., None], disparity, offsets=self.warp_offsets())

    def volume(
        self,
        index: int,
        features: Float[Array, "v u h w c"],
        candidates: Float[Array, " d"],
        before: Float[Array, "h w"] | None,
        maps: Float[Array, "v u h w"] | None,
    ) -> Float[Array, "d h w k"]:
        """Cost volume of a stage: coarse if there is no disparity before it, else refined."""
        weights = None if maps is None else occlusion_weights(maps)
        combine = COMBINED[self.config.stages[index].volume]
        if before is None:
            return coarse_volume(features, candidates, weights=weights, combine=combine)
        offsets = self.warp_offsets()
        return refined_volume(
            features, before, candidates, weights=weights, offsets=offsets, combine=combine
        )

    def warp_offsets(self) -> Float[Array, "v u 2"]:
        """Offsets of the views as the per-pixel warp takes them."""
        offsets = view_offsets(*of_kind(self.config.views, tuple))
        return offsets[..., ::-1] if self.config.warp == "transposed" else offsets

    def attend(self, index: int, mean: Float[Array, " k"]) -> Float[Array, "v u"] | None:
        """Weight of each view from the mean over a stage's volume, or None without attention."""
        attention = self.attention[self._part(index)]
        return None if attention is None else attention(mean)

    def aggregate(
        self,
        index: int,
        volume: Float[Array, "d h w k"],
        attention: Float[Array, "v u"] | None,
        *,
        train: bool = False,
    ) -> Float[Array, "d h w"]:
        """Scores of a stage's candidates from its volume, its views weighted by attention.

        Args:
            index: Number of the stage.
            volume: ``[d, h, w, k]``.
            attention: ``[v, u]`` weight of each view; None for one.
            train: Normalise by batch statistics.

        Returns:
            ``[d, h, w]``; the higher, the likelier the candidate.
        """
        if attention is not None:
            channels = of_kind(self.config.features, FeatureConfig).channels
            per_channel = jnp.repeat(attention.reshape(-1), channels)
            volume = volume * per_channel.astype(volume.dtype)[None, None, None]
        return self.aggregation[self._part(index)](volume, train=train)

    def _part(self, index: int) -> int:
        return 0 if self.config.shared_aggregation else index


def variable_shapes(config: NetworkConfig) -> dict:
    """Shapes and types of a network's variables, without computing any.

    Args:
        config: The network.

    Returns:
        ``variables`` with a ``jax.ShapeDtypeStruct`` in place of each array.
    """
    views = jax.ShapeDtypeStruct((*(config.views or (1, 3)), 16, 16), jnp.float32)
    truth = jax.ShapeDtypeStruct((16, 16), jnp.float32)  # some networks look at it
    return jax.eval_shape(
        lambda key, views, truth: OccCasNet(config).init(key, views, ground_truth=truth),
        jax.random.key(0),
        views,
        truth,
    )
