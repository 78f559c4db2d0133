"""Pictures with boxes from COCO folders, and what is done to them before the network sees them."""

import dataclasses
import json
import pathlib

import cv2
import numpy

# Grey that surrounds pictures that do not fill the input.
FILLING = 114
# The class of everything that has no class of its own, where a network has it.
OTHER = "other"
# Boxes of which less remains after cropping are no longer that object.
LEAST_VISIBLE = 0.35
# Nothing smaller can be learnt at a stride of 8, pixels.
LEAST_SIDE = 5
# So many inputs are turned by quarters: a camera sees floors the right way up, but things lie in all directions.
QUARTER_TURNS = 0.4


@dataclasses.dataclass
class Sample:
    """A picture (rows, columns, 3; red first) and its boxes: class, left, top, right, bottom in pixels."""

    picture: numpy.ndarray
    boxes: numpy.ndarray


def class_names(folder: pathlib.Path) -> list[str]:
    """Names of a COCO folder's categories, by their numbers."""
    content = json.loads((folder / "annotations.json").read_text())
    return [entry["name"] for entry in sorted(content["categories"], key=lambda entry: entry["id"])]


def read_coco(folder: pathlib.Path, names: list[str], limit: int = 0) -> list[Sample]:
    """All pictures of a COCO folder (`images/`, `annotations.json`), kept in memory.

    Categories that are not in `names` become "other" if that is one of them, else they are left out.
    """
    content = json.loads((folder / "annotations.json").read_text())
    wanted = {}
    for entry in content["categories"]:
        name = entry["name"] if entry["name"] in names else OTHER
        if name in names:
            wanted[entry["id"]] = names.index(name)
    boxes: dict[int, list] = {}
    for entry in content["annotations"]:
        if entry["category_id"] in wanted and not entry.get("iscrowd"):
            left, top, width, height = entry["bbox"]
            row = [wanted[entry["category_id"]], left, top, left + width, top + height]
            boxes.setdefault(entry["image_id"], []).append(row)
    samples = []
    for entry in content["images"][: limit or None]:
        path = folder / "images" / pathlib.Path(entry["file_name"]).name
        picture = cv2.imread(str(path), cv2.IMREAD_COLOR)
        if picture is None:
            raise SystemExit(f"{path}: cannot be read; remove it from annotations.json or put it there")
        rows = numpy.array(boxes.get(entry["id"], []), dtype=numpy.float32).reshape(-1, 5)
        samples.append(Sample(cv2.cvtColor(picture, cv2.COLOR_BGR2RGB), rows))
    return samples


def resized(sample: Sample, scale: float) -> Sample:
    """Larger or smaller by a factor; shrinking averages, as the host's does."""
    rows, columns = sample.picture.shape[:2]
    size = (max(1, round(columns * scale)), max(1, round(rows * scale)))
    method = cv2.INTER_AREA if scale < 1 else cv2.INTER_LINEAR
    boxes = sample.boxes.copy()
    boxes[:, [1, 3]] *= size[0] / columns
    boxes[:, [2, 4]] *= size[1] / rows
    return Sample(cv2.resize(sample.picture, size, interpolation=method), boxes)


def turned(sample: Sample, quarter_turns: int, mirrored: bool) -> Sample:
    """Turned counter-clockwise by quarters, then mirrored left to right."""
    picture, boxes = sample.picture, sample.boxes.copy()
    for _ in range(quarter_turns % 4):
        columns = picture.shape[1]
        picture = numpy.rot90(picture)
        boxes = numpy.stack(
            [boxes[:, 0], boxes[:, 2], columns - boxes[:, 3], boxes[:, 4], columns - boxes[:, 1]], axis=1
        )
    if mirrored:
        columns = picture.shape[1]
        picture = picture[:, ::-1]
        boxes[:, [1, 3]] = columns - boxes[:, [3, 1]]
    return Sample(numpy.ascontiguousarray(picture), boxes)


def paste(canvas: numpy.ndarray, area: tuple[int, int, int, int], sample: Sample, shift: tuple[int, int]) -> numpy.ndarray:
    """Draws the sample's part that falls into `area` (left, top, right, bottom of the canvas) when its corner lies at
    `shift`; returns the boxes that remain, in pixels of the canvas."""
    left, top, right, bottom = area
    rows, columns = sample.picture.shape[:2]
    u0, v0 = max(left, shift[0]), max(top, shift[1])
    u1, v1 = min(right, shift[0] + columns), min(bottom, shift[1] + rows)
    if u0 >= u1 or v0 >= v1:
        return numpy.zeros((0, 5), numpy.float32)
    canvas[v0:v1, u0:u1] = sample.picture[v0 - shift[1] : v1 - shift[1], u0 - shift[0] : u1 - shift[0]]
    boxes = sample.boxes + numpy.array([0, shift[0], shift[1], shift[0], shift[1]], numpy.float32)
    before = (boxes[:, 3] - boxes[:, 1]) * (boxes[:, 4] - boxes[:, 2])
    boxes[:, [1, 3]] = boxes[:, [1, 3]].clip(u0, u1)
    boxes[:, [2, 4]] = boxes[:, [2, 4]].clip(v0, v1)
    width, height = boxes[:, 3] - boxes[:, 1], boxes[:, 4] - boxes[:, 2]
    seen = (width * height > LEAST_VISIBLE * before) & (numpy.maximum(width, height) >= LEAST_SIDE)
    return boxes[seen & (numpy.minimum(width, height) >= 1)]


class Augmentation:
    """Makes inputs of `side` pixels from samples; all chance comes from `random`."""

    def __init__(self, samples: list[Sample], side: int, mosaic: float, random: numpy.random.Generator):
        self.samples, self.side, self.mosaic, self.random = samples, side, mosaic, random

    def _prepared(self, index: int, smallest: float, largest: float) -> Sample:
        """Turned at random, its longer side between two shares of the input's."""
        random = self.random
        sample = self.samples[index]
        share = numpy.exp(random.uniform(numpy.log(smallest), numpy.log(largest)))
        scale = share * self.side / max(sample.picture.shape[:2])
        quarters = int(random.integers(4)) if random.random() < QUARTER_TURNS else 0
        return turned(resized(sample, scale), quarters, bool(random.integers(2)))

    def single(self, index: int) -> Sample:
        """One picture, shrunk with grey around it or enlarged and cropped."""
        sample = self._prepared(index, 0.7, 1.6)
        rows, columns = sample.picture.shape[:2]
        side = self.side
        canvas = numpy.full((side, side, 3), FILLING, numpy.uint8)
        shift = tuple(int(self.random.integers(min(0, side - size), max(0, side - size) + 1)) for size in (columns, rows))
        return Sample(canvas, paste(canvas, (0, 0, side, side), sample, shift))

    def four(self, index: int) -> Sample:
        """Four pictures around a point."""
        side, random = self.side, self.random
        canvas = numpy.full((side, side, 3), FILLING, numpy.uint8)
        u, v = (int(side * share) for share in random.uniform(0.3, 0.7, 2))
        areas = ((0, 0, u, v), (u, 0, side, v), (0, v, u, side), (u, v, side, side))
        chosen = [index, *random.integers(len(self.samples), size=3)]
        boxes = []
        for area, choice in zip(areas, chosen):
            sample = self._prepared(int(choice), 0.6, 1.4)
            rows, columns = sample.picture.shape[:2]
            width, height = area[2] - area[0], area[3] - area[1]
            # Any part of a large picture, any place for a small one.
            shift = tuple(
                area[axis] + int(random.integers(min(0, room - size), max(0, room - size) + 1))
                for axis, (room, size) in enumerate(((width, columns), (height, rows)))
            )
            boxes.append(paste(canvas, area, sample, shift))
        return Sample(canvas, numpy.concatenate(boxes))

    def __call__(self, index: int) -> Sample:
        """One input, changed in geometry and light."""
        sample = self.four(index) if self.random.random() < self.mosaic else self.single(index)
        return Sample(degrade(sample.picture, sample.boxes, self.random), sample.boxes)


def degrade(picture: numpy.ndarray, boxes: numpy.ndarray, random: numpy.random.Generator) -> numpy.ndarray:
    """Light, colour, blur, noise, compression and missing patches, each with some chance."""
    if random.random() < 0.8:
        hue, saturation, value = random.uniform(-9, 9), random.uniform(0.4, 1.6), random.uniform(0.5, 1.5)
        levels = numpy.arange(256)
        tables = (
            ((levels + hue) % 180).astype(numpy.uint8),
            (levels * saturation).clip(0, 255).astype(numpy.uint8),
            (255 * (levels / 255) ** (1 / value)).clip(0, 255).astype(numpy.uint8),
        )
        channels = cv2.split(cv2.cvtColor(picture, cv2.COLOR_RGB2HSV))
        picture = cv2.merge([cv2.LUT(channel, table) for channel, table in zip(channels, tables)])
        picture = cv2.cvtColor(picture, cv2.COLOR_HSV2RGB)
    if random.random() < 0.4:
        gains, offset = random.uniform(0.75, 1.25, 3), random.uniform(-25, 25)
        table = (numpy.arange(256)[:, None] * gains[None] + offset).clip(0, 255).astype(numpy.uint8)
        picture = cv2.LUT(picture, table[None])
    if random.random() < 0.06:
        picture = cv2.cvtColor(cv2.cvtColor(picture, cv2.COLOR_RGB2GRAY), cv2.COLOR_GRAY2RGB)
    blur = random.random()
    if blur < 0.15:
        picture = cv2.GaussianBlur(picture, (0, 0), random.uniform(0.4, 1.6))
    elif blur < 0.25:
        length = int(random.integers(3, 9))
        kernel = numpy.zeros((length, length), numpy.float32)
        ends = random.integers(0, length, 2)
        cv2.line(kernel, (0, int(ends[0])), (length - 1, int(ends[1])), 1.0)
        kernel = kernel if random.random() < 0.5 else kernel.T
        picture = cv2.filter2D(picture, -1, kernel / kernel.sum())
    if random.random() < 0.3:
        noise = numpy.empty(picture.shape, numpy.int16)
        cv2.setRNGSeed(int(random.integers(2**31)))
        cv2.randn(noise, (0, 0, 0), (float(random.uniform(2, 14)),) * 3)
        picture = (picture + noise).clip(0, 255).astype(numpy.uint8)
    if random.random() < 0.15:
        quality = [cv2.IMWRITE_JPEG_QUALITY, int(random.integers(25, 85))]
        picture = cv2.imdecode(cv2.imencode(".jpg", picture, quality)[1], cv2.IMREAD_COLOR)
    if random.random() < 0.25:
        picture = with_missing_patches(picture, boxes, random)
    return picture


def with_missing_patches(picture: numpy.ndarray, boxes: numpy.ndarray, random: numpy.random.Generator) -> numpy.ndarray:
    """Covers up to a third of some objects and some floor with plain patches."""
    picture = picture.copy()
    side = picture.shape[0]
    for _ in range(int(random.integers(1, 4))):
        width, height = random.uniform(0.03, 0.15, 2) * side
        u, v = random.uniform(0, side, 2)
        if len(boxes) and random.random() < 0.6:
            _, left, top, right, bottom = boxes[int(random.integers(len(boxes)))]
            width, height = random.uniform(0.2, 0.55, 2) * (right - left, bottom - top)
            u, v = random.uniform(left, right), random.uniform(top, bottom)
        corner, opposite = (int(u - width / 2), int(v - height / 2)), (int(u + width / 2), int(v + height / 2))
        colour = [int(level) for level in random.integers(0, 256, 3)]
        cv2.rectangle(picture, corner, opposite, colour, -1)
    return picture
