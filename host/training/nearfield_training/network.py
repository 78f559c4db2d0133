"""The network: the architecture of YOLOv5 version 6, written from its published block diagram.

Layers, widths and depths follow Jocher et al., "YOLOv5" (2020), release 6: a CSP backbone, spatial pyramid pooling, a
feature pyramid up and down, three outputs at strides of 8, 16 and 32 pixels with three anchors each. No code or weights
of that project are used.
"""

import math

import torch
from torch import nn

from .backbone import CHANNELS, LiteBackbone, ScaledConvolution

# (depth multiple, width multiple) of the block diagram. "lite" has the neck and heads of n behind EfficientNet-Lite0.
SCALES = {"n": (0.33, 0.25), "s": (0.33, 0.50), "m": (0.67, 0.75), "lite": (0.33, 0.25)}
STRIDES = (8, 16, 32)
# Width and height in pixels of the input, three for each stride.
ANCHORS = (
    ((10, 13), (16, 30), (33, 23)),
    ((30, 61), (62, 45), (59, 119)),
    ((116, 90), (156, 198), (373, 326)),
)
ANCHORS_PER_CELL = 3


class ConvolutionBlock(nn.Module):
    """Convolution, batch normalisation, SiLU."""

    def __init__(self, inputs: int, outputs: int, kernel: int = 1, stride: int = 1, padding: int | None = None):
        super().__init__()
        padding = kernel // 2 if padding is None else padding
        self.convolution = nn.Conv2d(inputs, outputs, kernel, stride, padding, bias=False)
        self.normalisation: nn.Module = nn.BatchNorm2d(outputs, eps=1e-3, momentum=0.03)
        # Not in place: its gradient needs the input, which would be copied before.
        self.activation = nn.SiLU()

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """Features in, features out."""
        return self.activation(self.normalisation(self.convolution(x)))


class Bottleneck(nn.Module):
    """1x1 and 3x3 convolution, with the input added where `shortcut`."""

    def __init__(self, channels: int, shortcut: bool):
        super().__init__()
        self.narrow = ConvolutionBlock(channels, channels, 1)
        self.wide = ConvolutionBlock(channels, channels, 3)
        self.shortcut = shortcut

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """Features in, features out."""
        y = self.wide(self.narrow(x))
        return x + y if self.shortcut else y


class CrossStage(nn.Module):
    """Cross-stage partial block with three convolutions ("C3")."""

    def __init__(self, inputs: int, outputs: int, repeats: int, shortcut: bool = True):
        super().__init__()
        half = outputs // 2
        self.main = ConvolutionBlock(inputs, half)
        self.bypass = ConvolutionBlock(inputs, half)
        self.join = ConvolutionBlock(2 * half, outputs)
        self.chain = nn.Sequential(*(Bottleneck(half, shortcut) for _ in range(repeats)))

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """Features in, features out."""
        return self.join(torch.cat([self.chain(self.main(x)), self.bypass(x)], 1))


class PyramidPooling(nn.Module):
    """Spatial pyramid pooling by repeated 5x5 maxima ("SPPF")."""

    def __init__(self, inputs: int, outputs: int):
        super().__init__()
        half = inputs // 2
        self.before = ConvolutionBlock(inputs, half)
        self.after = ConvolutionBlock(4 * half, outputs)
        self.pool = nn.MaxPool2d(5, 1, 2)

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """Features in, features out."""
        x = self.before(x)
        once = self.pool(x)
        twice = self.pool(once)
        return self.after(torch.cat([x, once, twice, self.pool(twice)], 1))


class Yolo(nn.Module):
    """The detector.

    In training, and with `decoded = False`, it returns three tensors (batch, 3 * (5 + classes), rows, columns). With
    `decoded = True` it returns (batch, boxes, 5 + classes): centre x, centre y, width, height in pixels of the input,
    objectness and class scores after the sigmoid.
    """

    def __init__(self, scale: str, classes: int):
        super().__init__()
        depth, width = SCALES[scale]

        def channels(count: int) -> int:
            return max(8, math.ceil(count * width / 8) * 8)

        def repeats(count: int) -> int:
            return max(round(count * depth), 1)

        c1, c2, c3, c4, c5 = (channels(count) for count in (64, 128, 256, 512, 1024))
        self.classes, self.numbers, self.decoded = classes, classes + 5, False
        if scale == "lite":
            self.backbone = LiteBackbone()
            self.p3, self.p4 = ConvolutionBlock(CHANNELS[0], c3), ConvolutionBlock(CHANNELS[1], c4)
            self.p5 = nn.Sequential(PyramidPooling(CHANNELS[2], c5), ConvolutionBlock(c5, c4))
        else:
            self.backbone = None
            self.to_p2 = nn.Sequential(ConvolutionBlock(3, c1, 6, 2, 2), ConvolutionBlock(c1, c2, 3, 2))
            self.to_p3 = nn.Sequential(CrossStage(c2, c2, repeats(3)), ConvolutionBlock(c2, c3, 3, 2))
            self.p3 = CrossStage(c3, c3, repeats(6))
            self.p4 = nn.Sequential(ConvolutionBlock(c3, c4, 3, 2), CrossStage(c4, c4, repeats(9)))
            self.p5 = nn.Sequential(
                ConvolutionBlock(c4, c5, 3, 2), CrossStage(c5, c5, repeats(3)), PyramidPooling(c5, c5), ConvolutionBlock(c5, c4)
            )
        self.up4 = nn.Sequential(CrossStage(c4 * 2, c4, repeats(3), False), ConvolutionBlock(c4, c3))
        self.up3 = CrossStage(c3 * 2, c3, repeats(3), False)
        self.down4 = ConvolutionBlock(c3, c3, 3, 2)
        self.out4 = CrossStage(c3 * 2, c4, repeats(3), False)
        self.down5 = ConvolutionBlock(c4, c4, 3, 2)
        self.out5 = CrossStage(c4 * 2, c5, repeats(3), False)
        self.heads = nn.ModuleList(nn.Conv2d(c, ANCHORS_PER_CELL * self.numbers, 1) for c in (c3, c4, c5))
        self.register_buffer("anchors", torch.tensor(ANCHORS, dtype=torch.float32))
        self._start_from_rare_objects()

    def _start_from_rare_objects(self) -> None:
        """Biases such that an untrained network expects about eight objects in a picture of 640 pixels."""
        for head, stride in zip(self.heads, STRIDES):
            bias = head.bias.detach().view(ANCHORS_PER_CELL, -1)
            bias[:, 4] += math.log(8 / (640 / stride) ** 2)
            bias[:, 5:] += math.log(0.6 / (self.classes - 0.99))
            head.bias = nn.Parameter(bias.reshape(-1))

    def forward(self, x: torch.Tensor) -> list[torch.Tensor] | torch.Tensor:
        """Pictures (batch, 3, side, side), 0 to 1, red first."""
        p3, p4, p5 = self._features(x)
        t4 = self.up4(torch.cat([_twice(p5), p4], 1))
        o3 = self.up3(torch.cat([_twice(t4), p3], 1))
        o4 = self.out4(torch.cat([self.down4(o3), t4], 1))
        o5 = self.out5(torch.cat([self.down5(o4), p5], 1))
        outputs = [head(features) for head, features in zip(self.heads, (o3, o4, o5))]
        return self.decode(outputs) if self.decoded else outputs

    def _features(self, x: torch.Tensor) -> list[torch.Tensor]:
        """Features at strides of 8, 16 and 32."""
        if self.backbone is not None:
            return [part(features) for part, features in zip((self.p3, self.p4, self.p5), self.backbone(x))]
        p3 = self.p3(self.to_p3(self.to_p2(x)))
        p4 = self.p4(p3)
        return [p3, p4, self.p5(p4)]

    def decode(self, outputs: list[torch.Tensor]) -> torch.Tensor:
        """From cells to boxes in pixels of the input."""
        boxes = []
        for level, (output, stride) in enumerate(zip(outputs, STRIDES)):
            batch, _, rows, columns = output.shape
            y = output.view(batch, ANCHORS_PER_CELL, self.numbers, rows, columns).permute(0, 1, 3, 4, 2).sigmoid()
            v, u = torch.meshgrid(
                torch.arange(rows, device=y.device), torch.arange(columns, device=y.device), indexing="ij"
            )
            cells = torch.stack([u, v], -1).to(y.dtype) - 0.5
            centre = (y[..., 0:2] * 2 + cells) * stride
            size = (y[..., 2:4] * 2) ** 2 * self.anchors[level].view(1, ANCHORS_PER_CELL, 1, 1, 2)
            boxes.append(torch.cat([centre, size, y[..., 4:]], -1).reshape(batch, -1, self.numbers))
        return torch.cat(boxes, 1)

    def fuse(self) -> "Yolo":
        """Folds the normalisations into the convolutions, for use without training."""
        for module in self.modules():
            if isinstance(module, ScaledConvolution):
                module.fold()
            if isinstance(module, ConvolutionBlock) and isinstance(module.normalisation, nn.BatchNorm2d):
                module.convolution = nn.utils.fusion.fuse_conv_bn_eval(module.convolution, module.normalisation)
                module.normalisation = nn.Identity()
        return self


def _twice(x: torch.Tensor) -> torch.Tensor:
    return nn.functional.interpolate(x, scale_factor=2.0, mode="nearest")
