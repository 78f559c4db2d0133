"""Holds `nearfield evaluate` against pycocotools: random detections, and the detector's own on a COCO folder."""

import argparse
import contextlib
import io
import json
import pathlib
import subprocess
import tempfile

import cv2
import numpy
from pycocotools.coco import COCO
from pycocotools.cocoeval import COCOeval

MOST_DIFFERENCE = 1e-6
FIGURES = ("ap", "ap50", "ap75", "ap_small", "ap_medium", "ap_large", "ar1", "ar10", "ar100", "ar_small", "ar_medium", "ar_large")
NAMES = ["bolt", "nut", "washer", "hand", "foot"]


def random_folder(folder: pathlib.Path, random: numpy.random.Generator) -> None:
    """A COCO folder and detections of all kinds: near misses, wrong classes, equal scores, crowds, empty pictures."""
    (folder / "images").mkdir(parents=True)
    images, annotations, detections = [], [], []
    for index in range(40):
        number = int(random.integers(10_000)) * 40 + index
        images.append({"id": number, "file_name": f"{index}.png"})
        cv2.imwrite(str(folder / "images" / f"{index}.png"), numpy.zeros((8, 8, 3), numpy.uint8))
        for _ in range(int(random.integers(0, 9))):
            box = numpy.concatenate([random.uniform(0, 400, 2), numpy.exp(random.uniform(1, 5.5, 2))])
            category = int(random.integers(1, 6))
            crowd = int(random.random() < 0.08)
            entry = {"id": len(annotations) + 1, "image_id": number, "category_id": category, "iscrowd": crowd}
            area = float(box[2] * box[3] * random.uniform(0.3, 1))
            annotations.append(entry | {"bbox": [float(value) for value in box], "area": area})
            for _ in range(int(random.integers(0, 4))):
                moved = box + numpy.concatenate([random.normal(0, 0.1, 2) * box[2:], random.normal(0, 0.1, 2) * box[2:]])
                moved[2:] = moved[2:].clip(1)
                other = int(random.integers(1, 6)) if random.random() < 0.1 else category
                score = float(numpy.round(random.random(), int(random.integers(1, 5))))
                place = [float(value) for value in moved]
                detections.append({"image_id": number, "category_id": other, "bbox": place, "score": score})
        for _ in range(int(random.integers(0, 130 if index % 10 == 0 else 4))):
            place = [float(value) for value in [*random.uniform(0, 400, 2), *numpy.exp(random.uniform(1, 5, 2))]]
            entry = {"image_id": number, "category_id": int(random.integers(1, 6)), "bbox": place}
            detections.append(entry | {"score": float(random.random())})
    categories = [{"id": index + 1, "name": name} for index, name in enumerate(NAMES)]
    content = {"images": images, "annotations": annotations, "categories": categories}
    (folder / "annotations.json").write_text(json.dumps(content))
    (folder / "detections.json").write_text(json.dumps(detections))


def reference(folder: pathlib.Path, detections: pathlib.Path, names: list[str]) -> list[float]:
    """pycocotools' twelve numbers over the categories of these names."""
    with contextlib.redirect_stdout(io.StringIO()):
        truth = COCO(str(folder / "annotations.json"))
        evaluation = COCOeval(truth, truth.loadRes(str(detections)), "bbox")
        evaluation.params.catIds = [number for number in truth.getCatIds() if truth.cats[number]["name"] in names]
        evaluation.evaluate()
        evaluation.accumulate()
        evaluation.summarize()
    return [float(value) for value in evaluation.stats]


def compare(program: list[str], folder: pathlib.Path, detections: pathlib.Path) -> float:
    """The largest difference of a figure."""
    command = [*program, "--json", "--dataset", str(folder), "--detections", str(detections)]
    answer = json.loads(subprocess.run(command, capture_output=True, text=True, check=True).stdout)
    ours = [answer[0]["coco"][figure] for figure in FIGURES]
    names = [entry["class"] for entry in answer[0]["classes"]]
    return max(abs(one - other) for one, other in zip(ours, reference(folder, detections, names)))


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of `cross-check`."""
    parser.add_argument("--program", default="../../target/release/nearfield", help="the command nearfield")
    parser.add_argument("--model", type=pathlib.Path, help="a network other than the built-in one")
    parser.add_argument("--data", type=pathlib.Path, help="a COCO folder; categories that the program does not know are left out")
    parser.add_argument("--rounds", type=int, default=20)
    parser.add_argument("--seed", type=int, default=1)


def run(options: argparse.Namespace) -> None:
    """Compares; ends with an error where figures differ."""
    program = [options.program, "evaluate", *(["--model", str(options.model)] if options.model else [])]
    worst = 0.0
    for round_number in range(options.rounds):
        with tempfile.TemporaryDirectory() as scratch:
            folder = pathlib.Path(scratch) / "data"
            random_folder(folder, numpy.random.default_rng([options.seed, round_number]))
            difference = compare(program, folder, folder / "detections.json")
            print(f"random, seed {options.seed}/{round_number}: {difference:.2e}")
            worst = max(worst, difference)
    if options.data:
        with tempfile.TemporaryDirectory() as scratch:
            detections = pathlib.Path(scratch) / "detections.json"
            command = [*program, "--dataset", str(options.data), "--write-detections", str(detections)]
            subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
            difference = compare(program, options.data, detections)
            print(f"{options.data}: {difference:.2e}")
            worst = max(worst, difference)
    if worst > MOST_DIFFERENCE:
        raise SystemExit(f"figures differ by {worst:.2e}; at most {MOST_DIFFERENCE:.0e} is allowed")
    print(f"largest difference {worst:.2e}")
