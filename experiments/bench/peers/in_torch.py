"""The published network in PyTorch."""

from __future__ import annotations

import torch
from torch import Tensor, nn
from torch.nn import functional

from experiments.bench.peers.description import (
    Network,
    Problem,
    Program,
    Stage,
    Variables,
    octant_of_views,
)

NORM = {"eps": 1e-3, "momentum": 0.01}
"""Options of BatchNorm; PyTorch's momentum is the weight of the new value."""


class ResidualBlock(nn.Module):
    """Block of conv-BN-ReLU-conv-BN plus the input, after a 1x1 convolution if projected."""

    def __init__(self, width: int, channels: int, dilation: int, *, projected: bool) -> None:
        super().__init__()
        options = {"padding": dilation, "dilation": dilation, "bias": False}
        self.conv_0 = nn.Conv2d(width, channels, 3, **options)
        self.norm_0 = nn.BatchNorm2d(channels, **NORM)
        self.conv_1 = nn.Conv2d(channels, channels, 3, **options)
        self.norm_1 = nn.BatchNorm2d(channels, **NORM)
        if projected:
            self.shortcut = nn.Conv2d(width, channels, 1, bias=False)
            self.shortcut_norm = nn.BatchNorm2d(channels, **NORM)
        self.projected = projected

    def forward(self, x: Tensor) -> Tensor:
        """Apply the block to images ``[n, c, h, w]``."""
        shortcut = self.shortcut_norm(self.shortcut(x)) if self.projected else x
        x = functional.relu(self.norm_0(self.conv_0(x)))
        return self.norm_1(self.conv_1(x)) + shortcut


class Features(nn.Module):
    """Feature network."""

    def __init__(self, network: Network) -> None:
        super().__init__()
        self.network = network

        def layer(name: str, width: int, channels: int, size: int) -> None:
            conv = nn.Conv2d(width, channels, size, padding=size // 2, bias=False)
            self.add_module(name, conv)
            self.add_module(f"{name}_norm", nn.BatchNorm2d(channels, **NORM))

        layer("stem_0", 1, network.stem, 3)
        layer("stem_1", network.stem, network.stem, 3)
        width = network.stem
        for group, (channels, blocks, dilation) in enumerate(network.groups):
            for block in range(blocks):
                projected = block == 0 and group > 0
                module = ResidualBlock(width, channels, dilation, projected=projected)
                self.add_module(f"group_{group}_block_{block}", module)
                width = channels
        for size in network.pooled:
            layer(f"pooled_{size}", width, network.pooled_width, 1)
        joined = network.groups[1][0] + width + len(network.pooled) * network.pooled_width
        layer("fused", joined, network.fused, 3)
        self.output = nn.Conv2d(network.fused, network.channels, 1, bias=False)

    def forward(self, images: Tensor) -> Tensor:
        """Return features ``[n, c, h, w]`` of images ``[n, 1, h, w]``."""

        def layer(name: str, x: Tensor) -> Tensor:
            conv, norm = self.get_submodule(name), self.get_submodule(f"{name}_norm")
            return functional.relu(norm(conv(x)))

        x = layer("stem_1", layer("stem_0", images))
        groups = []
        for group, (_, blocks, _) in enumerate(self.network.groups):
            for block in range(blocks):
                x = self.get_submodule(f"group_{group}_block_{block}")(x)
            groups.append(x)
        pyramid = [
            functional.interpolate(
                layer(f"pooled_{size}", average_pool(x, size)),
                size=images.shape[2:],
                mode="bilinear",
                align_corners=True,
            )
            for size in self.network.pooled
        ]
        return self.output(layer("fused", torch.cat([groups[1], x, *reversed(pyramid)], 1)))


def average_pool(x: Tensor, size: int) -> Tensor:
    """Average blocks; blocks at the border average only the pixels inside the image."""
    margins = []
    for length in (x.shape[3], x.shape[2]):
        lacking = -length % size
        margins += [lacking // 2, lacking - lacking // 2]
    inside = functional.pad(torch.ones_like(x[:1, :1]), margins)
    pooled = functional.avg_pool2d(functional.pad(x, margins), size)
    return pooled / functional.avg_pool2d(inside, size)


class Attention(nn.Module):
    """Channel attention: a weight for each view from the means over the volume."""

    def __init__(self, network: Network) -> None:
        super().__init__()
        octant = octant_of_views(network.side)
        self.channels = network.channels
        self.hidden = nn.Linear(network.side**2 * network.channels, network.attention_width)
        self.octant = nn.Linear(network.attention_width, int(octant.max()) + 1)
        of_view = torch.from_numpy(octant.reshape(-1))
        self.register_buffer("of_view", of_view, persistent=False)

    def forward(self, mean: Tensor) -> Tensor:
        """Return the weights ``[b, v * u * c]`` of the channels from their means."""
        octant = torch.sigmoid(self.octant(functional.relu(self.hidden(mean))))
        return octant[:, self.of_view].repeat_interleave(self.channels, 1)


class Aggregation(nn.Module):
    """3x3x3 convolutions that compute a score for each candidate."""

    def __init__(self, network: Network, stage: Stage) -> None:
        super().__init__()
        self.pairs = stage.pairs
        depth, width = network.side**2 * network.channels, stage.width
        pairs = [f"pair_{pair}_conv_{half}" for pair in range(stage.pairs) for half in (0, 1)]
        for name in ("conv_0", "conv_1", *pairs, "conv_2"):
            self.add_module(name, nn.Conv3d(depth, width, 3, padding=1, bias=False))
            self.add_module(f"{name}_norm", nn.BatchNorm3d(width, **NORM))
            depth = width
        self.score = nn.Conv3d(width, 1, 3, padding=1, bias=False)

    def forward(self, volume: Tensor) -> Tensor:
        """Return scores ``[b, d, h, w]`` of a volume ``[b, c, d, h, w]``."""

        def layer(name: str, x: Tensor) -> Tensor:
            return self.get_submodule(f"{name}_norm")(self.get_submodule(name)(x))

        x = functional.relu(layer("conv_0", volume))
        x = functional.relu(layer("conv_1", x))
        for pair in range(self.pairs):
            inner = functional.relu(layer(f"pair_{pair}_conv_0", x))
            x = x + layer(f"pair_{pair}_conv_1", inner)
        return self.score(functional.relu(layer("conv_2", x)))[:, 0]


class OccCasNet(nn.Module):
    """The cascade.

    With ``half``, convolutions use bfloat16 with float32 accumulation; the rest uses float32.
    """

    def __init__(self, network: Network, *, half: bool = False) -> None:
        super().__init__()
        self.network, self.half = network, half
        self.features = Features(network)
        for index, stage in enumerate(network.stages):
            self.add_module(f"attention_{index}", Attention(network))
            self.add_module(f"aggregation_{index}", Aggregation(network, stage))
            candidates = torch.tensor(stage.candidates)
            self.register_buffer(f"candidates_{index}", candidates, persistent=False)

    def forward(self, views: Tensor) -> list[Tensor]:
        """Return the disparities ``[b, h, w]`` of all stages from views ``[b, v, u, h, w]``."""
        batch, side, _, height, width = views.shape
        images = views.reshape(batch, side**2, 1, height, width)
        centre = images[:, side**2 // 2, None]
        half = torch.autocast(views.device.type, torch.bfloat16, enabled=self.half)
        with half:
            flat = images.flatten(0, 1).to(memory_format=torch.channels_last)
            features = self.features(flat).unflatten(0, (batch, side**2))
        disparity = views.new_zeros(batch, height, width)
        disparities = []
        for index, stage in enumerate(self.network.stages):
            weights, border = views.new_ones(()), "border" if index else "zeros"
            if stage.occlusion:
                difference = (warp(images, disparity, border) - centre).abs().clamp(0, 1)
                weights = (1 - difference) ** 2
            candidates = self.get_buffer(f"candidates_{index}")
            planes = [
                (warp(features, disparity + candidate, border) * weights).to(features.dtype)
                for candidate in candidates
            ]
            volume = torch.stack([plane.flatten(1, 2) for plane in planes], 2)
            mean = volume.mean((2, 3, 4), dtype=torch.float32)
            attention = self.get_submodule(f"attention_{index}")(mean).to(volume.dtype)
            volume = (volume * attention[:, :, None, None, None]).contiguous(
                memory_format=torch.channels_last_3d
            )
            with half:
                scores = self.get_submodule(f"aggregation_{index}")(volume).float()
            probabilities = torch.softmax(scores, 1)
            disparity = disparity + (probabilities * candidates[:, None, None]).sum(1)
            disparities.append(disparity)
        return disparities


def warp(images: Tensor, disparity: Tensor, border: str) -> Tensor:
    """Warp views ``[b, v * u, c, h, w]`` of a square grid to the centre view, in float32."""
    batch, number, _, height, width = images.shape
    side, device = round(number**0.5), images.device
    offset = torch.arange(side, device=device) - side // 2
    down, right = (each.reshape(-1, 1, 1) for each in torch.meshgrid(offset, offset, indexing="ij"))
    y = torch.arange(height, device=device)[:, None] - disparity[:, None] * down
    x = torch.arange(width, device=device)[None, :] - disparity[:, None] * right
    # grid_sample expects coordinates in [-1, 1] from corner to corner.
    grid = torch.stack([2 * x / max(width - 1, 1) - 1, 2 * y / max(height - 1, 1) - 1], -1)
    flat = images.flatten(0, 1).float()
    warped = functional.grid_sample(flat, grid.flatten(0, 1), "bilinear", border, True)
    return warped.unflatten(0, (batch, number))


def state(variables: Variables) -> dict[str, Tensor]:
    """Return variables for ``load_state_dict``: renamed, with kernels ``[out, in, *taps]``."""
    names = {"kernel": "weight", "scale": "weight", "mean": "running_mean", "var": "running_var"}
    converted = {}
    for path, value in variables.items():
        *module, name = path.split("/")
        if name == "kernel":
            axes = range(value.ndim)
            value = value.transpose(axes[-1], axes[-2], *axes[:-2])
        converted[".".join([*module, names.get(name, name)])] = torch.from_numpy(value.copy())
    return converted


def load(problem: Problem, device: str, precision: str) -> OccCasNet:
    """Return the network with its variables on a device; kernels are in channels-last layout."""
    if device == "cuda":
        torch.backends.cudnn.benchmark = True
        torch.backends.cudnn.allow_tf32 = False  # no TF32
    module = OccCasNet(problem.network, half=precision == "bfloat16")
    missing, unexpected = module.load_state_dict(state(problem.variables), strict=False)
    assert not unexpected
    assert all(name.endswith("num_batches_tracked") for name in missing), missing
    for part in module.modules():
        if isinstance(part, nn.Conv2d):
            part.to(memory_format=torch.channels_last)
        if isinstance(part, nn.Conv3d):
            part.to(memory_format=torch.channels_last_3d)
    return module.to(device)


def finish(device: str) -> None:
    """Wait for the device."""
    if device == "cuda":
        torch.cuda.synchronize()


def peak_memory(device: str) -> int:
    """Largest memory of an accelerator that was in use, in bytes."""
    return torch.cuda.max_memory_allocated() if device == "cuda" else 0


def build(
    problem: Problem, *, device: str = "cpu", precision: str = "float32", compiled: bool = False
) -> Program:
    """Build the inference of one light field.

    Args:
        problem: The network and the light field.
        device: ``"cpu"`` or ``"cuda"``.
        precision: Number type of convolutions, ``"float32"`` or ``"bfloat16"``.
        compiled: Compile by ``torch.compile``.
    """
    module = load(problem, device, precision).eval()
    estimate = torch.compile(module) if compiled else module
    views = torch.from_numpy(problem.views).to(device)

    @torch.inference_mode()
    def run() -> Tensor:
        disparity = estimate(views)[-1][0]
        finish(device)
        return disparity

    return Program(run, lambda result: result.cpu().numpy(), lambda: peak_memory(device))


def train(
    problem: Problem,
    *,
    rate: float,
    device: str = "cpu",
    precision: str = "float32",
    compiled: bool = False,
) -> Program:
    """Build steps of Adam on one batch.

    Args:
        problem: The network, the light fields and their disparity.
        rate: Learning rate.
        device: ``"cpu"`` or ``"cuda"``.
        precision: Number type of convolutions, ``"float32"`` or ``"bfloat16"``.
        compiled: Compile forward and backward pass by ``torch.compile``.
    """
    module = load(problem, device, precision).train()
    views, truth = (torch.from_numpy(each).to(device) for each in (problem.views, problem.truth))
    optimiser = torch.optim.Adam(module.parameters(), rate)

    def loss_of(views: Tensor, truth: Tensor) -> Tensor:
        return sum((disparity - truth).abs().mean() for disparity in module(views))

    compute = torch.compile(loss_of) if compiled else loss_of

    def run() -> Tensor:
        optimiser.zero_grad()
        loss = compute(views, truth)
        loss.backward()
        norm = nn.utils.get_total_norm([each.grad for each in module.parameters()])
        optimiser.step()
        finish(device)
        return torch.stack([loss.detach(), norm])

    return Program(run, lambda result: result.cpu().numpy(), lambda: peak_memory(device))
