"""What onnxruntime, Pillow and numpy make of some pictures: the host's tests compare with it.

The file holds for each picture the input's values at some places, the network's strongest rows, the boxes, and what the
classifier makes of some of them.
"""

import argparse
import json
import pathlib

import numpy
import onnxruntime
from PIL import Image

from .predict import boxes_of, letterbox
from .regions import region

LEAST_SCORE = 0.05
# Places of the input that are compared, spread by a prime.
STEP = 4099
ROWS = 20
# So many boxes are shown to the classifier.
NAMED = 6
# Two ways of shrinking a picture differ by a level here and there. A box that hangs on that is no fact about the network: among
# cells that are all but equally sure, another one wins. Steady ones come back from so many inputs with such noise ...
NOISY = 16
# ... at the same place, pixels of the picture, with the same score.
SAME_PLACE, SAME_SCORE = 1.0, 0.02


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of `goldens`."""
    parser.add_argument("--model", type=pathlib.Path, required=True, help="the .onnx file, its card beside it")
    parser.add_argument("--out", type=pathlib.Path, required=True, help="the .json file")
    parser.add_argument("pictures", type=pathlib.Path, nargs="+")


def steady(session: onnxruntime.InferenceSession, planes: numpy.ndarray, boxes: numpy.ndarray, boxes_in) -> list[bool]:
    """Which boxes come back from inputs of which a fifth of the samples differs by a level? `boxes_in` tells the boxes of the network's rows."""
    random = numpy.random.default_rng(1)
    kept = [True] * len(boxes)
    for _ in range(NOISY):
        noise = random.choice([-1, 0, 1], planes.shape, p=[0.1, 0.8, 0.1]).astype(numpy.float32) / numpy.float32(255)
        rows = session.run(None, {"picture": (planes + noise).clip(0, 1)[None]})[0][0]
        found = boxes_in(rows)
        for index, box in enumerate(boxes):
            near = numpy.abs(found[:, :4] - box[:4]).max(1) <= SAME_PLACE
            same = near & (numpy.abs(found[:, 4] - box[4]) <= SAME_SCORE) & (found[:, 5] == box[5])
            kept[index] &= bool(same.any())
    return kept


def named(session: onnxruntime.InferenceSession, side: int, picture: numpy.ndarray, boxes: numpy.ndarray) -> list[dict]:
    """What the classifier makes of the first boxes."""
    answer = []
    for box in boxes[:NAMED]:
        shares = session.run(None, {"region": region(picture, box[:4], side)[None]})[0].reshape(-1)
        answer.append({"place": [float(value) for value in box[:4]], "shares": [float(share) for share in shares]})
    return answer


def golden(
    session: onnxruntime.InferenceSession, card: dict, classifier: tuple[onnxruntime.InferenceSession, int] | None, path: pathlib.Path
) -> dict:
    """One picture's values."""
    picture = numpy.asarray(Image.open(path).convert("RGB"))
    planes, back = letterbox(picture, card["input_side"])
    rows = session.run(None, {"picture": planes[None]})[0][0]
    strongest = numpy.argsort(-(rows[:, 4] * rows[:, 5:].max(1)), kind="stable")[:ROWS]

    def boxes_in(answer: numpy.ndarray) -> numpy.ndarray:
        return boxes_of(answer, back, (picture.shape[1], picture.shape[0]), LEAST_SCORE, card["largest_overlap"])

    boxes = boxes_in(rows)
    firm = steady(session, planes, boxes, boxes_in)
    return {
        "picture": path.name,
        "input": [[int(place), float(planes.reshape(-1)[place])] for place in range(0, planes.size, STEP)],
        "rows": [{"row": int(row), "numbers": [float(value) for value in rows[row]]} for row in strongest],
        "boxes": [
            {"class": int(box[5]), "score": float(box[4]), "place": [float(value) for value in box[:4]], "steady": is_steady}
            for box, is_steady in zip(boxes, firm)
        ],
        "named": named(*classifier, picture, boxes) if classifier else [],
    }


def run(options: argparse.Namespace) -> None:
    """Writes the file."""
    card = json.loads(options.model.with_suffix(".json").read_text())
    session = onnxruntime.InferenceSession(str(options.model), providers=["CPUExecutionProvider"])
    classifier = None
    if "classifier" in card:
        path = options.model.with_name(card["classifier"])
        side = json.loads(path.with_suffix(".json").read_text())["input_side"]
        classifier = onnxruntime.InferenceSession(str(path), providers=["CPUExecutionProvider"]), side
    content = [golden(session, card, classifier, path) for path in options.pictures]
    options.out.write_text(json.dumps(content) + "\n")
    print(f"{options.out}: {[len(entry['boxes']) for entry in content]} boxes")
