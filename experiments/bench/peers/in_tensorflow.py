"""The published network in TensorFlow 2."""

from __future__ import annotations

import numpy as np
import tensorflow as tf

from experiments.bench.peers.description import (
    Network,
    Problem,
    Program,
    Stage,
    Variables,
    octant_of_views,
)

EPSILON = 1e-3
MOMENTUM = 0.99


class OccCasNet(tf.Module):
    """The cascade.

    For inference its variables are constants, so that the graph optimiser can fold them.
    """

    def __init__(self, network: Network, variables: Variables, *, training: bool = False) -> None:
        super().__init__()
        self.network, self.training = network, training
        self.values = {
            name: tf.Variable(value, trainable=name.rpartition("/")[2] not in ("mean", "var"))
            if training
            else tf.constant(value)
            for name, value in variables.items()
        }

    def __call__(self, views: tf.Tensor) -> list[tf.Tensor]:
        """Return the disparities ``[b, h, w]`` of all stages from views ``[b, v, u, h, w]``."""
        batch, side, _, height, width = views.shape
        images = tf.reshape(views, (batch, side**2, height, width, 1))
        centre = images[:, side**2 // 2, None]
        flat = tf.reshape(images, (batch * side**2, height, width, 1))
        features = tf.reshape(self.features(flat), (batch, side**2, height, width, -1))
        disparity = tf.zeros((batch, height, width))
        disparities = []
        for index, stage in enumerate(self.network.stages):
            weights = tf.ones(())
            if stage.occlusion:
                difference = tf.abs(warp(images, disparity) - centre)
                weights = (1 - tf.clip_by_value(difference, 0, 1)) ** 2
            planes = []
            for candidate in stage.candidates:
                if index == 0:
                    registered = shift(features, candidate)
                else:
                    registered = warp(features, disparity + candidate)
                plane = tf.transpose(registered * weights, (0, 2, 3, 1, 4))
                planes.append(tf.reshape(plane, (batch, height, width, -1)))
            volume = tf.stack(planes, 1)
            attention = self.attention(index, tf.reduce_mean(volume, (1, 2, 3)))
            scores = self.aggregation(index, stage, volume * attention[:, None, None, None])
            candidates = tf.constant(stage.candidates)[:, None, None]
            disparity = disparity + tf.reduce_sum(tf.nn.softmax(scores, 1) * candidates, 1)
            disparities.append(disparity)
        return disparities

    def conv(self, name: str, x: tf.Tensor, dilation: int = 1) -> tf.Tensor:
        """Convolve images or a volume with zero padding."""
        kernel = self.values[f"{name}/kernel"]
        if len(kernel.shape) == 5:
            return tf.nn.conv3d(x, kernel, (1, 1, 1, 1, 1), "SAME")
        return tf.nn.conv2d(x, kernel, 1, "SAME", dilations=dilation)

    def norm(self, name: str, x: tf.Tensor) -> tf.Tensor:
        """Apply BatchNorm; in training, by the statistics of the batch, and update the averages."""
        mean, variance, bias, scale = (
            self.values[f"{name}/{part}"] for part in ("mean", "var", "bias", "scale")
        )
        if self.training:
            running = mean, variance
            mean, variance = tf.nn.moments(x, list(range(len(x.shape) - 1)))
            for average, value in zip(running, (mean, variance), strict=True):
                average.assign(MOMENTUM * average + (1 - MOMENTUM) * value)
        return tf.nn.batch_normalization(x, mean, variance, bias, scale, EPSILON)

    def layer(self, name: str, x: tf.Tensor) -> tf.Tensor:
        """Apply a convolution, BatchNorm and ReLU."""
        return tf.nn.relu(self.norm(f"{name}_norm", self.conv(name, x)))

    def features(self, images: tf.Tensor) -> tf.Tensor:
        """Return features ``[n, h, w, c]`` of images ``[n, h, w, 1]``."""
        network = self.network
        x = self.layer("features/stem_1", self.layer("features/stem_0", images))
        groups = []
        for group, (_, blocks, dilation) in enumerate(network.groups):
            for block in range(blocks):
                name = f"features/group_{group}_block_{block}"
                x = self.block(name, x, dilation, projected=block == 0 and group > 0)
            groups.append(x)
        pyramid = [
            tf.raw_ops.ResizeBilinear(
                images=self.layer(
                    f"features/pooled_{size}", tf.nn.avg_pool2d(x, size, size, "SAME")
                ),
                size=images.shape[1:3],
                align_corners=True,
            )
            for size in network.pooled
        ]
        joined = tf.concat([groups[1], x, *reversed(pyramid)], -1)
        return self.conv("features/output", self.layer("features/fused", joined))

    def block(self, name: str, x: tf.Tensor, dilation: int, *, projected: bool) -> tf.Tensor:
        """Apply conv-BN-ReLU-conv-BN and add the input, after a 1x1 convolution if projected."""
        shortcut = x
        if projected:
            shortcut = self.norm(f"{name}/shortcut_norm", self.conv(f"{name}/shortcut", x))
        x = tf.nn.relu(self.norm(f"{name}/norm_0", self.conv(f"{name}/conv_0", x, dilation)))
        return self.norm(f"{name}/norm_1", self.conv(f"{name}/conv_1", x, dilation)) + shortcut

    def attention(self, index: int, mean: tf.Tensor) -> tf.Tensor:
        """Return the weights ``[b, v * u * c]`` of a volume's channels from their means."""

        def dense(name: str, x: tf.Tensor) -> tf.Tensor:
            kernel, bias = (
                self.values[f"attention_{index}/{name}/{part}"] for part in ("kernel", "bias")
            )
            return tf.linalg.matmul(x, kernel) + bias

        octant = tf.sigmoid(dense("octant", tf.nn.relu(dense("hidden", mean))))
        of_view = octant_of_views(self.network.side).reshape(-1)
        return tf.repeat(tf.gather(octant, of_view, axis=1), self.network.channels, 1)

    def aggregation(self, index: int, stage: Stage, volume: tf.Tensor) -> tf.Tensor:
        """Return scores ``[b, d, h, w]`` of a volume ``[b, d, h, w, c]``."""
        part = f"aggregation_{index}"
        x = self.layer(f"{part}/conv_1", self.layer(f"{part}/conv_0", volume))
        for pair in range(stage.pairs):
            inner = self.layer(f"{part}/pair_{pair}_conv_0", x)
            last = f"{part}/pair_{pair}_conv_1"
            x = x + self.norm(f"{last}_norm", self.conv(last, inner))
        return self.conv(f"{part}/score", self.layer(f"{part}/conv_2", x))[..., 0]


def offsets(number: int) -> np.ndarray:
    """Return the ``[v * u, 2]`` offsets (row, column) of a square grid from its centre view."""
    side = round(number**0.5)
    grid = np.indices((side, side)).reshape(2, -1).T - side // 2
    return grid.astype(np.float32)


def shift(images: tf.Tensor, disparity: float) -> tf.Tensor:
    """Shift views ``[b, v * u, h, w, c]`` by a constant disparity; zero outside the image."""
    batch, number, height, width, channels = images.shape
    down, right = -disparity * offsets(number).T
    zero, one = np.zeros_like(down), np.ones_like(down)
    moves = np.stack([one, zero, right, zero, one, down, zero, zero], 1)
    moved = tf.raw_ops.ImageProjectiveTransformV3(
        images=tf.reshape(images, (batch * number, height, width, channels)),
        transforms=np.tile(moves, (batch, 1)),
        output_shape=(height, width),
        interpolation="BILINEAR",
        fill_mode="CONSTANT",
        fill_value=0.0,
    )
    return tf.reshape(moved, images.shape)


def warp(images: tf.Tensor, disparity: tf.Tensor) -> tf.Tensor:
    """Warp views ``[b, v * u, h, w, c]`` by disparities ``[b, h, w]``; the border replicates."""
    batch, number, height, width, channels = images.shape
    down, right = offsets(number).T[:, :, None, None]
    y = np.arange(height, dtype=np.float32)[:, None] - disparity[:, None] * down
    x = np.arange(width, dtype=np.float32)[None, :] - disparity[:, None] * right
    y, x = tf.clip_by_value(y, 0, height - 1), tf.clip_by_value(x, 0, width - 1)
    row = tf.minimum(tf.cast(y, tf.int32), max(height - 2, 0))
    column = tf.minimum(tf.cast(x, tf.int32), max(width - 2, 0))
    fraction_y = (y - tf.cast(row, tf.float32))[..., None]
    fraction_x = (x - tf.cast(column, tf.float32))[..., None]
    flat = tf.reshape(images, (batch, number, height * width, channels))

    def tap(down: int, right: int) -> tf.Tensor:
        return tf.gather(flat, (row + down) * width + column + right, batch_dims=2)

    upper = tap(0, 0) * (1 - fraction_x) + tap(0, 1) * fraction_x
    lower = tap(1, 0) * (1 - fraction_x) + tap(1, 1) * fraction_x
    return upper * (1 - fraction_y) + lower * fraction_y


def peak_memory() -> int:
    """Return the peak memory of the accelerator in bytes; 0 without an accelerator."""
    if not tf.config.list_physical_devices("GPU"):
        return 0
    return tf.config.experimental.get_memory_info("GPU:0")["peak"]


def build(problem: Problem, *, compiled: bool = True) -> Program:
    """Build the inference of one light field, in float32.

    Args:
        problem: The network and the light field.
        compiled: Compile to a graph by ``tf.function``.
    """
    tf.config.experimental.enable_tensor_float_32_execution(False)  # no TF32
    module = OccCasNet(problem.network, problem.variables)
    estimate = tf.function(module) if compiled else module
    views = tf.constant(problem.views)

    def run() -> tf.Tensor:
        return finished(estimate(views)[-1][0])

    return Program(run, lambda result: result.numpy(), peak_memory)


def train(problem: Problem, *, rate: float, compiled: bool = True) -> Program:
    """Build steps of Adam on one batch, in float32.

    Args:
        problem: The network, the light fields and their disparity.
        rate: Learning rate.
        compiled: Compile to a graph by ``tf.function``.
    """
    tf.config.experimental.enable_tensor_float_32_execution(False)
    module = OccCasNet(problem.network, problem.variables, training=True)
    views, truth = tf.constant(problem.views), tf.constant(problem.truth)
    weights = module.trainable_variables
    optimiser = tf.keras.optimizers.Adam(rate, epsilon=1e-8)
    optimiser.build(weights)

    def step(views: tf.Tensor, truth: tf.Tensor) -> tf.Tensor:
        with tf.GradientTape() as tape:
            loss = tf.add_n([tf.reduce_mean(tf.abs(each - truth)) for each in module(views)])
        gradients = tape.gradient(loss, weights)
        optimiser.apply_gradients(zip(gradients, weights, strict=True))
        return tf.stack([loss, tf.linalg.global_norm(gradients)])

    advance = tf.function(step) if compiled else step
    return Program(
        lambda: finished(advance(views, truth)), lambda result: result.numpy(), peak_memory
    )


def finished(result: tf.Tensor) -> tf.Tensor:
    """Wait for the device and return the result."""
    tf.test.experimental.sync_devices()
    return result
