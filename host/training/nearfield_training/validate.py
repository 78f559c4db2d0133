"""Mean average precision of a network on a COCO folder while it is being trained."""

import contextlib
import io

import numpy
import torch
from pycocotools.coco import COCO
from pycocotools.cocoeval import COCOeval

from .dataset import Sample
from .network import Yolo
from .predict import boxes_of, letterbox

LEAST_SCORE = 0.01
BATCH = 16


def coco_of(samples: list[Sample], classes: int) -> COCO:
    """The samples' boxes in pycocotools' form."""
    annotations = []
    for index, sample in enumerate(samples):
        for box in sample.boxes:
            width, height = float(box[3] - box[1]), float(box[4] - box[2])
            entry = {"id": len(annotations) + 1, "image_id": index + 1, "category_id": int(box[0]) + 1, "iscrowd": 0}
            entry |= {"bbox": [float(box[1]), float(box[2]), width, height], "area": width * height}
            annotations.append(entry)
    truth = COCO()
    truth.dataset = {
        "images": [{"id": index + 1} for index in range(len(samples))],
        "categories": [{"id": index + 1} for index in range(classes)],
        "annotations": annotations,
    }
    with contextlib.redirect_stdout(io.StringIO()):
        truth.createIndex()
    return truth


@torch.no_grad()
def mean_average_precision(network: Yolo, samples: list[Sample], side: int) -> tuple[float, float, list[float]]:
    """(mAP at 0.5, mAP at 0.5:0.95, AP at 0.5 by class; -1 where the class does not occur)."""
    network.eval().decoded = True
    results = []
    for start in range(0, len(samples), BATCH):
        prepared = [letterbox(sample.picture, side) for sample in samples[start : start + BATCH]]
        inputs = torch.from_numpy(numpy.stack([planes for planes, _ in prepared]))
        with torch.autocast("cpu", dtype=torch.bfloat16):
            answers = network(inputs.contiguous(memory_format=torch.channels_last)).float().numpy()
        for offset, (rows, (_, back)) in enumerate(zip(answers, prepared)):
            shape = samples[start + offset].picture.shape
            for box in boxes_of(rows, back, (shape[1], shape[0]), LEAST_SCORE, 0.5)[:100]:
                place = [float(box[0]), float(box[1]), float(box[2] - box[0]), float(box[3] - box[1])]
                entry = {"image_id": start + offset + 1, "category_id": int(box[5]) + 1}
                results.append(entry | {"bbox": place, "score": float(box[4])})
    network.decoded = False
    if not results:
        return 0.0, 0.0, [0.0] * network.classes
    truth = coco_of(samples, network.classes)
    with contextlib.redirect_stdout(io.StringIO()):
        evaluation = COCOeval(truth, truth.loadRes(results), "bbox")
        evaluation.evaluate()
        evaluation.accumulate()
        evaluation.summarize()
    by_class = evaluation.eval["precision"][0, :, :, 0, 2].mean(0)
    return float(evaluation.stats[1]), float(evaluation.stats[0]), [float(value) for value in by_class]
