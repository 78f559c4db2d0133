"""Boxes out of a network in Python: for validation while training, and to compare the host's Rust with.

The host's code is the product; this is a second, independent way to the same numbers.
"""

import numpy
from PIL import Image

from .dataset import FILLING


def letterbox(picture: numpy.ndarray, side: int) -> tuple[numpy.ndarray, tuple[float, float, int, int]]:
    """Input (3, side, side), 0 to 1, and how to come back: pixels of the picture for one of the input across and down,
    filling to the left and above."""
    rows, columns = picture.shape[:2]
    longer = max(rows, columns)
    width, height = (min(side, max(1, int(length * side / longer + 0.5))) for length in (columns, rows))
    left, top = (side - width) // 2, (side - height) // 2
    canvas = numpy.full((side, side, 3), FILLING, numpy.uint8)
    shrunk = Image.fromarray(picture).resize((width, height), Image.Resampling.BILINEAR)
    canvas[top : top + height, left : left + width] = numpy.asarray(shrunk)
    planes = numpy.ascontiguousarray(canvas.transpose(2, 0, 1), dtype=numpy.float32) / numpy.float32(255)
    return planes, (columns / width, rows / height, left, top)


def overlaps(box: numpy.ndarray, others: numpy.ndarray) -> numpy.ndarray:
    """Intersection over union of one box with many (left, top, right, bottom)."""
    low = numpy.maximum(box[:2], others[:, :2])
    high = numpy.minimum(box[2:], others[:, 2:])
    common = (high - low).clip(0).prod(1)
    area = (box[2:] - box[:2]).prod()
    return common / (area + (others[:, 2:] - others[:, :2]).prod(1) - common + 1e-12)


def suppress(boxes: numpy.ndarray, scores: numpy.ndarray, largest_overlap: float) -> list[int]:
    """Indices of the boxes that stay, best first."""
    order = numpy.argsort(-scores, kind="stable")
    kept = []
    while len(order):
        best, order = order[0], order[1:]
        kept.append(int(best))
        order = order[overlaps(boxes[best], boxes[order]) <= largest_overlap]
    return kept


def boxes_of(rows: numpy.ndarray, back, size: tuple[int, int], least_score: float, largest_overlap: float) -> numpy.ndarray:
    """(left, top, right, bottom, score, class) in pixels of the picture from the network's rows."""
    scores = rows[:, 4:5] * rows[:, 5:]
    row, class_index = numpy.nonzero(scores >= least_score)
    centre, half = rows[row, :2], rows[row, 2:4] / 2
    boxes = numpy.concatenate([centre - half, centre + half], 1)
    boxes = (boxes - numpy.array([back[2], back[3]] * 2)) * numpy.array([back[0], back[1]] * 2)
    boxes[:, [0, 2]] = boxes[:, [0, 2]].clip(0, size[0])
    boxes[:, [1, 3]] = boxes[:, [1, 3]].clip(0, size[1])
    score = scores[row, class_index]
    found = []
    for one in numpy.unique(class_index):
        chosen = numpy.nonzero(class_index == one)[0]
        kept = chosen[suppress(boxes[chosen], score[chosen], largest_overlap)]
        found.append(numpy.column_stack([boxes[kept], score[kept], numpy.full(len(kept), one)]))
    merged = numpy.concatenate(found) if found else numpy.zeros((0, 6))
    return merged[numpy.argsort(-merged[:, 4], kind="stable")][:300]
