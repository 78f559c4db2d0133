"""A toy dataset of drawn shapes, to see training work in a minute. It teaches nothing about real floors."""

import argparse
import json
import pathlib

import cv2
import numpy

NAMES = ["washer", "bolt", "wire"]


def draw(canvas: numpy.ndarray, kind: int, random: numpy.random.Generator) -> tuple[float, float, float, float]:
    """Draws one thing; returns its box (left, top, width, height)."""
    side = canvas.shape[0]
    mask = numpy.zeros(canvas.shape[:2], numpy.uint8)
    u, v = (int(value) for value in random.uniform(0.15, 0.85, 2) * side)
    size = int(random.uniform(0.06, 0.16) * side)
    if kind == 0:
        cv2.circle(mask, (u, v), size, 255, max(3, size // 2))
    elif kind == 1:
        angle = random.uniform(0, numpy.pi)
        end = (int(u + 2 * size * numpy.cos(angle)), int(v + 2 * size * numpy.sin(angle)))
        cv2.line(mask, (u, v), end, 255, max(3, size // 3))
        cv2.circle(mask, (u, v), max(3, size // 2), 255, -1)
    else:
        points = numpy.cumsum(random.normal(0, size, (6, 2)), axis=0) + (u, v)
        points = points.clip(4, side - 4)
        cv2.polylines(mask, [points.astype(numpy.int32)], False, 255, 3)
    colour = random.integers(0, 2, 3) * 120 + random.integers(0, 100, 3)
    canvas[mask > 0] = colour
    rows, columns = numpy.nonzero(mask)
    left, top = int(columns.min()), int(rows.min())
    return left, top, int(columns.max()) + 1 - left, int(rows.max()) + 1 - top


def write(folder: pathlib.Path, count: int, side: int, random: numpy.random.Generator) -> None:
    """One COCO folder."""
    (folder / "images").mkdir(parents=True, exist_ok=True)
    content = {"images": [], "annotations": []}
    content["categories"] = [{"id": index + 1, "name": name} for index, name in enumerate(NAMES)]
    for index in range(count):
        grey = random.integers(90, 200)
        canvas = (grey + random.normal(0, 6, (side, side, 3))).clip(0, 255).astype(numpy.uint8)
        name = f"{index:05}.png"
        for _ in range(int(random.integers(0, 5))):
            kind = int(random.integers(len(NAMES)))
            box = draw(canvas, kind, random)
            entry = {"id": len(content["annotations"]) + 1, "image_id": index + 1, "category_id": kind + 1}
            content["annotations"].append(entry | {"bbox": box, "area": box[2] * box[3], "iscrowd": 0})
        cv2.imwrite(str(folder / "images" / name), canvas)
        content["images"].append({"id": index + 1, "file_name": name, "width": side, "height": side})
    (folder / "annotations.json").write_text(json.dumps(content))


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of `toy`."""
    parser.add_argument("--out", type=pathlib.Path, required=True)
    parser.add_argument("--images", type=int, default=200)
    parser.add_argument("--side", type=int, default=160)
    parser.add_argument("--seed", type=int, default=1)


def run(options: argparse.Namespace) -> None:
    """Writes train/ and val/."""
    random = numpy.random.default_rng(options.seed)
    write(options.out / "train", options.images, options.side, random)
    write(options.out / "val", max(10, options.images // 5), options.side, random)
    print(f"{options.images} pictures to learn from in {options.out}/train, some more in {options.out}/val")
