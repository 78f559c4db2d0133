"""Regions of pictures that a classifier names: what the host cuts out around a detector's box, and what there is to learn.

A detector sees a whole picture, shrunk into its input; a classifier looks once more at each place that it found, in the
picture's own resolution. It must name what the detector really shows it: so it learns from the detector's boxes, the wrong
ones among them, and not from annotations alone.
"""

import json
import math
import multiprocessing
import pathlib

import numpy
import onnxruntime
from tqdm import tqdm

from .dataset import Sample
from .predict import letterbox, overlaps, suppress

# Side of the region, in longer sides of the box: the floor around a thing tells its size and what it is part of.
CONTEXT = 1.4
# Boxes of a detector with a smaller score are not looked at.
LEAST_SCORE = 0.02
# Boxes that overlap more than this show the same thing, whatever their classes.
SAME_PLACE = 0.7
# A box shows an object from this overlap on, and none below that one; between them it teaches nothing.
OBJECT, NO_OBJECT = 0.5, 0.3
MOST_BOXES = 20


def window(box: numpy.ndarray, columns: int, rows: int) -> tuple[int, int, int, int]:
    """Whole pixels (left, top, right, bottom) around a box (left, top, right, bottom), as far as the picture goes; never empty."""
    half = max(box[2] - box[0], box[3] - box[1]) * CONTEXT / 2
    across, down = (box[0] + box[2]) / 2, (box[1] + box[3]) / 2
    left, right = max(0, math.floor(across - half)), min(columns, math.ceil(across + half))
    top, bottom = max(0, math.floor(down - half)), min(rows, math.ceil(down + half))
    left, top = min(left, columns - 1), min(top, rows - 1)
    return left, top, max(right, left + 1), max(bottom, top + 1)


def region(picture: numpy.ndarray, box: numpy.ndarray, side: int) -> numpy.ndarray:
    """The classifier's input for a box: (3, side, side), 0 to 1, grey where the picture ends."""
    left, top, right, bottom = window(box, picture.shape[1], picture.shape[0])
    return letterbox(picture[top:bottom, left:right], side)[0]


def detected(session: onnxruntime.InferenceSession, side: int, picture: numpy.ndarray) -> numpy.ndarray:
    """Places (left, top, right, bottom) that a detector finds, best first, one for each thing whatever it is called."""
    planes, (across, down, left, top) = letterbox(picture, side)
    rows = session.run(None, {"picture": planes[None]})[0][0]
    scores = rows[:, 4] * rows[:, 5:].max(1)
    rows, scores = rows[scores >= LEAST_SCORE], scores[scores >= LEAST_SCORE]
    boxes = numpy.concatenate([rows[:, :2] - rows[:, 2:4] / 2, rows[:, :2] + rows[:, 2:4] / 2], 1)
    boxes = (boxes - numpy.array([left, top] * 2)) * numpy.array([across, down] * 2)
    limits = numpy.array([picture.shape[1], picture.shape[0]] * 2)
    boxes = boxes.clip(0, limits)
    return boxes[suppress(boxes, scores, SAME_PLACE)[:MOST_BOXES]]


def labels(found: numpy.ndarray, annotated: numpy.ndarray, background: int) -> numpy.ndarray:
    """What each place (left, top, right, bottom) shows: the class of the annotated box (class, left, top, right, bottom) that it
    fits best, `background`, or -1 where that cannot be told."""
    answer = numpy.full(len(found), background)
    for index, box in enumerate(found):
        if len(annotated):
            share = overlaps(box, annotated[:, 1:])
            best = int(share.argmax())
            answer[index] = annotated[best, 0] if share[best] >= OBJECT else -1 if share[best] >= NO_OBJECT else background
    return answer


class Finder:
    """A detector for one process: what it finds in pictures, and what that shows."""

    def __init__(self, detector: pathlib.Path, classes: int):
        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = 1
        self.session = onnxruntime.InferenceSession(str(detector), options, providers=["CPUExecutionProvider"])
        self.side = json.loads(detector.with_suffix(".json").read_text())["input_side"]
        self.classes = classes

    def rows(self, sample: Sample) -> list[list[float]]:
        """Class (`classes` for the background), left, top, right, bottom."""
        found = detected(self.session, self.side, sample.picture)
        shown = labels(found, sample.boxes, self.classes)
        return [[int(one), *box] for one, box in zip(shown, found) if one >= 0]


def _start(detector: pathlib.Path, classes: int) -> None:
    global finder
    finder = Finder(detector, classes)


def _rows(sample: Sample) -> list[list[float]]:
    return finder.rows(sample)


def collect(samples: list[Sample], detector: pathlib.Path, classes: int, processes: int, annotations: bool) -> numpy.ndarray:
    """Everything to learn from: rows of picture, class (`classes` for the background), left, top, right, bottom.

    The detector's boxes, and with `annotations` the annotated ones too.
    """
    rows = []
    with multiprocessing.get_context("spawn").Pool(processes, _start, (detector, classes)) as pool:
        found = tqdm(pool.imap(_rows, samples), "places found", len(samples), mininterval=5, dynamic_ncols=True)
        for index, (sample, places) in enumerate(zip(samples, found)):
            rows += [[index, *place] for place in places]
            if annotations:
                rows += [[index, *box] for box in sample.boxes]
    return numpy.array(rows, numpy.float32).reshape(-1, 6)
