"""Inputs for the quantisation by Hailo's compiler: an array (pictures, side, side, 3) of bytes, red first."""

import argparse
import pathlib

import numpy

from .dataset import class_names, read_coco
from .predict import letterbox


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of `calibration-set`."""
    parser.add_argument("--data", type=pathlib.Path, required=True, help="a COCO folder: pictures like those in use")
    parser.add_argument("--out", type=pathlib.Path, required=True, help="the .npy file")
    parser.add_argument("--images", type=int, default=1024)
    parser.add_argument("--side", type=int, default=320)


def run(options: argparse.Namespace) -> None:
    """Writes the array."""
    samples = read_coco(options.data, class_names(options.data), options.images)
    inputs = [letterbox(sample.picture, options.side)[0] for sample in samples]
    array = (numpy.stack(inputs).transpose(0, 2, 3, 1) * 255).round().astype(numpy.uint8)
    options.out.parent.mkdir(parents=True, exist_ok=True)
    numpy.save(options.out, array)
    print(f"{options.out}: {array.shape}")
