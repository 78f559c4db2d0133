"""What onnxruntime, Pillow and numpy make of some pictures: the host's tests compare with it.

The file holds for each picture the input's values at some places, the network's strongest rows, and the boxes.
"""

import argparse
import json
import pathlib

import numpy
import onnxruntime
from PIL import Image

from .predict import boxes_of, letterbox

LEAST_SCORE = 0.05
# Places of the input that are compared, spread by a prime.
STEP = 4099
ROWS = 20


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of `goldens`."""
    parser.add_argument("--model", type=pathlib.Path, required=True, help="the .onnx file, its card beside it")
    parser.add_argument("--out", type=pathlib.Path, required=True, help="the .json file")
    parser.add_argument("pictures", type=pathlib.Path, nargs="+")


def golden(session: onnxruntime.InferenceSession, card: dict, path: pathlib.Path) -> dict:
    """One picture's values."""
    picture = numpy.asarray(Image.open(path).convert("RGB"))
    planes, back = letterbox(picture, card["input_side"])
    rows = session.run(None, {"picture": planes[None]})[0][0]
    strongest = numpy.argsort(-(rows[:, 4] * rows[:, 5:].max(1)), kind="stable")[:ROWS]
    boxes = boxes_of(rows, back, (picture.shape[1], picture.shape[0]), LEAST_SCORE, card["largest_overlap"])
    return {
        "picture": path.name,
        "input": [[int(place), float(planes.reshape(-1)[place])] for place in range(0, planes.size, STEP)],
        "rows": [{"row": int(row), "numbers": [float(value) for value in rows[row]]} for row in strongest],
        "boxes": [
            {"class": int(box[5]), "score": float(box[4]), "place": [float(value) for value in box[:4]]} for box in boxes
        ],
    }


def run(options: argparse.Namespace) -> None:
    """Writes the file."""
    card = json.loads(options.model.with_suffix(".json").read_text())
    session = onnxruntime.InferenceSession(str(options.model), providers=["CPUExecutionProvider"])
    content = [golden(session, card, path) for path in options.pictures]
    options.out.write_text(json.dumps(content) + "\n")
    print(f"{options.out}: {[len(entry['boxes']) for entry in content]} boxes")
