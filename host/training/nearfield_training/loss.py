"""Which cells are responsible for which objects, and how wrong they are.

Targets are rows (picture, class, centre x, centre y, width, height) in pixels of the input.
"""

import math

import torch
import torch.nn.functional as functional

from .network import ANCHORS_PER_CELL, STRIDES, Yolo

# An anchor is responsible for objects up to this many times larger or smaller in either direction.
LARGEST_RATIO = 4.0
# Objectness: there are four times as many cells at each finer stride.
OBJECTNESS_BALANCE = (4.0, 1.0, 0.4)
BOX_GAIN, OBJECTNESS_GAIN, CLASS_GAIN = 0.15, 1.0, 0.5


def assign(targets: torch.Tensor, anchors: torch.Tensor, stride: int, rows: int, columns: int):
    """For one stride: (target, anchor, column, row) index tensors of all responsible cells.

    An object belongs to the cell of its centre and to the two neighbours nearest to that centre.
    """
    ratio = targets[:, None, 4:6] / anchors[None]
    fits = torch.maximum(ratio, 1 / ratio).amax(2) < LARGEST_RATIO
    target, anchor = fits.nonzero(as_tuple=True)
    x, y = targets[target, 2] / stride, targets[target, 3] / stride
    column, row = x.long().clamp(0, columns - 1), y.long().clamp(0, rows - 1)
    found = [(target, anchor, column, row)]
    neighbours = (
        (x - column < 0.5, -1, 0),
        (x - column >= 0.5, 1, 0),
        (y - row < 0.5, 0, -1),
        (y - row >= 0.5, 0, 1),
    )
    for near, right, down in neighbours:
        u, v = column + right, row + down
        keep = near & (u >= 0) & (u < columns) & (v >= 0) & (v < rows)
        found.append((target[keep], anchor[keep], u[keep], v[keep]))
    return tuple(torch.cat(parts) for parts in zip(*found))


def complete_overlap(one: torch.Tensor, other: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
    """Complete and plain intersection over union of boxes (centre x, centre y, width, height), row by row.

    Source: Zheng et al., "Distance-IoU loss", AAAI 2020.
    """
    low_1, high_1 = one[:, :2] - one[:, 2:] / 2, one[:, :2] + one[:, 2:] / 2
    low_2, high_2 = other[:, :2] - other[:, 2:] / 2, other[:, :2] + other[:, 2:] / 2
    common = (torch.minimum(high_1, high_2) - torch.maximum(low_1, low_2)).clamp(0).prod(1)
    overlap = common / (one[:, 2:].prod(1) + other[:, 2:].prod(1) - common + 1e-7)
    hull = torch.maximum(high_1, high_2) - torch.minimum(low_1, low_2)
    distance = ((one[:, :2] - other[:, :2]) ** 2).sum(1) / ((hull**2).sum(1) + 1e-7)
    angle = torch.atan(other[:, 2] / (other[:, 3] + 1e-7)) - torch.atan(one[:, 2] / (one[:, 3] + 1e-7))
    shape = 4 / math.pi**2 * angle**2
    with torch.no_grad():
        weight = shape / (shape - overlap + 1 + 1e-7)
    return overlap - distance - weight * shape, overlap


def detection_loss(network: Yolo, outputs: list[torch.Tensor], targets: torch.Tensor):
    """(loss, [box, objectness, class] without gains) of a batch."""
    box = objectness = classification = torch.zeros(())
    classes = network.classes
    for level, (output, stride) in enumerate(zip(outputs, STRIDES)):
        batch, _, rows, columns = output.shape
        cells = output.float().view(batch, ANCHORS_PER_CELL, classes + 5, rows, columns).permute(0, 1, 3, 4, 2)
        expected = torch.zeros(batch, ANCHORS_PER_CELL, rows, columns)
        anchors = network.anchors[level]
        target, anchor, u, v = assign(targets, anchors, stride, rows, columns)
        if len(target):
            truth = targets[target]
            picture = truth[:, 0].long()
            guess = cells[picture, anchor, v, u]
            centre = (guess[:, :2].sigmoid() * 2 - 0.5 + torch.stack([u, v], 1)) * stride
            size = (guess[:, 2:4].sigmoid() * 2) ** 2 * anchors[anchor]
            complete, overlap = complete_overlap(torch.cat([centre, size], 1), truth[:, 2:6])
            box = box + (1 - complete).mean()
            # Several objects may claim a cell: the best overlap counts, whatever their order.
            place = ((picture * ANCHORS_PER_CELL + anchor) * rows + v) * columns + u
            expected.view(-1).scatter_reduce_(0, place, overlap.detach().clamp(0), "amax")
            wanted = functional.one_hot(truth[:, 1].long(), classes).float()
            classification = classification + functional.binary_cross_entropy_with_logits(guess[:, 5:], wanted)
        objectness = objectness + OBJECTNESS_BALANCE[level] * functional.binary_cross_entropy_with_logits(
            cells[..., 4], expected
        )
    # The mean over classes shrinks with their number; 80 classes are the reference of the gains.
    class_gain = CLASS_GAIN * 3 * classes / 20
    loss = BOX_GAIN * box + OBJECTNESS_GAIN * objectness + class_gain * classification
    return loss, torch.stack([box.detach(), objectness.detach(), classification.detach()])
