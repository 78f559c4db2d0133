"""The way back from an exported network to one that learns on: `train --start-from detector.onnx`.

An exported network has its normalisations folded into its convolutions. What they were cannot be told from it, but any
normalisation with the statistics that its features really have, and a factor and offset that undo it, computes the same:
so the statistics are measured on some pictures.
"""

import pathlib
from collections.abc import Iterable

import numpy
import onnx
import torch

from .backbone import LiteBackbone, ScaledConvolution
from .network import ConvolutionBlock, Yolo


def tensors(path: pathlib.Path) -> dict[str, torch.Tensor]:
    """Kernels of a network's file by name, kept as bytes or not, and by that name and ".bias" what their convolutions add.

    Equal constants are one in the file, so offsets go by their convolution's kernel and not by their own name.
    """
    graph = onnx.load(str(path)).graph
    values = {tensor.name: onnx.numpy_helper.to_array(tensor) for tensor in graph.initializer}
    for node in graph.node:
        if node.op_type == "DequantizeLinear" and all(name in values for name in node.input):
            stored, scale, zero = (values[name].astype(numpy.float32) for name in node.input)
            shape = (-1,) + (1,) * (stored.ndim - 1)
            values[node.output[0]] = (stored - zero.reshape(shape)) * scale.reshape(shape)
    for node in graph.node:
        if node.op_type == "Identity" and node.input[0] in values:
            values[node.output[0]] = values[node.input[0]]
    for node in graph.node:
        if node.op_type == "Conv" and len(node.input) == 3 and node.input[2] in values:
            values[f"{node.input[1]}.bias"] = values[node.input[2]]
    return {name: torch.from_numpy(numpy.array(value)) for name, value in values.items()}


def _fill(target: torch.Tensor, values: dict[str, torch.Tensor], name: str, path: pathlib.Path) -> None:
    found = values.get(name)
    if found is None or found.shape != target.shape:
        shape = "missing" if found is None else f"of shape {tuple(found.shape)}"
        raise SystemExit(
            f"{path}: {name} is {shape}, expected {tuple(target.shape)}: another --scale or other --classes, "
            "or not a file of `export`"
        )
    target.copy_(found)


@torch.no_grad()
def take(network: Yolo, path: pathlib.Path, inputs: Iterable[torch.Tensor]) -> None:
    """Makes `network` compute what the file's does, ready to learn; `inputs` (batch, 3, side, side) tell its statistics."""
    values = tensors(path)
    sums: dict[ConvolutionBlock, list[torch.Tensor]] = {}
    hooks = []
    for name, module in network.named_modules():
        if isinstance(module, ScaledConvolution):
            _take_scaled(module, values, name, path)
        elif isinstance(module, ConvolutionBlock):
            _fill(module.convolution.weight, values, f"{name}.convolution.weight", path)
            normalisation = module.normalisation
            _fill(normalisation.bias, values, f"{name}.convolution.weight.bias", path)
            # Changes nothing yet.
            normalisation.weight.fill_(1)
            normalisation.running_mean.fill_(0)
            normalisation.running_var.fill_(1 - normalisation.eps)
            hooks.append(module.convolution.register_forward_hook(_counting(sums, module)))
    for index, head in enumerate(network.heads):
        _fill(head.weight, values, f"heads.{index}.weight", path)
        _fill(head.bias, values, f"heads.{index}.weight.bias", path)
    was_training = network.training
    network.eval()
    for batch in inputs:
        network(batch)
    network.train(was_training)
    for hook in hooks:
        hook.remove()
    for module, (count, total, squares) in sums.items():
        mean = total / count
        variance = (squares / count - mean**2).clamp(0)
        normalisation = module.normalisation
        normalisation.bias.add_(mean.float())
        normalisation.weight.copy_(torch.sqrt(variance + normalisation.eps))
        normalisation.running_mean.copy_(mean)
        normalisation.running_var.copy_(variance)


@torch.no_grad()
def take_backbone(backbone: LiteBackbone, path: pathlib.Path) -> None:
    """Takes only the backbone of an exported network of scale lite, its kernels scaled to learn at the pace of fresh ones."""
    values = tensors(path)
    for name, module in backbone.named_modules():
        if isinstance(module, ScaledConvolution):
            _take_scaled(module, values, f"backbone.{name}", path)
            length = module.kernel.flatten(1).norm(dim=1).clamp(1e-6) / 2**0.5
            module.factor.copy_(length)
            module.kernel.div_(length[:, None, None, None])


def _take_scaled(module: ScaledConvolution, values: dict[str, torch.Tensor], name: str, path: pathlib.Path) -> None:
    _fill(module.kernel, values, f"{name}.kernel", path)
    _fill(module.offset, values, f"{name}.kernel.bias", path)
    module.factor.fill_(1)


def _counting(sums: dict, module: ConvolutionBlock):
    def hook(_module, _inputs, output: torch.Tensor) -> None:
        values = output.double()
        fresh = [values.numel() / values.shape[1], values.sum((0, 2, 3)), (values**2).sum((0, 2, 3))]
        sums[module] = [old + new for old, new in zip(sums[module], fresh)] if module in sums else fresh

    return hook
