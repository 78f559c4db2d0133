"""From a classifier's weights to what the host reads: ONNX with kernels stored as bytes, its card, and its place in the detector's card."""

import argparse
import json
import pathlib

import onnx
import torch

from .backbone import ScaledConvolution
from .classifier import SIDE, Classifier
from .cut import steps
from .export import OPSET, write_compact
from .regions import CONTEXT

NAME = "classifier"
# The classifier's part in the mixed score, and how many places of a picture it names: chosen on the validation pictures.
WEIGHT, MOST_PLACES = 0.6, 8


def load(path: pathlib.Path) -> tuple[Classifier, dict]:
    """The averaged weights of a checkpoint, ready for use."""
    state = torch.load(path, weights_only=True)
    network = Classifier(len(state["names"]))
    network.load_state_dict(state["average"])
    for module in network.modules():
        if isinstance(module, ScaledConvolution):
            module.fold()
    network.shares = True
    return network.eval(), state


def card(state: dict, cut: list[dict]) -> dict:
    """What the host must know."""
    content = {"schema": "nearfield-classifier-1", "name": NAME, "input_side": SIDE, "context": CONTEXT}
    content |= {"classes": state["names"], "weight": WEIGHT, "most_places": MOST_PLACES}
    content |= {"steps": cut} if cut else {}
    about = {"architecture": "EfficientNet-Lite0 (began with TensorFlow's weights, Apache-2.0), regions of 64 x 64 pixels"}
    return content | {"about": about | {"epochs": state["epoch"]}}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of `export-classifier`."""
    parser.add_argument("--weights", type=pathlib.Path, required=True, help="best.pt or last.pt")
    parser.add_argument("--detector", type=pathlib.Path, required=True, help="the detector's ONNX file: written beside it, and named in its card")


def run(options: argparse.Namespace) -> None:
    """Writes the files."""
    network, state = load(options.weights)
    target = options.detector.with_name(f"{NAME}.onnx")
    detector_card = options.detector.with_suffix(".json")
    content = json.loads(detector_card.read_text())
    if content["classes"] != state["names"]:
        raise SystemExit(f"{options.weights} has other classes than {detector_card}")
    plain = target.with_suffix(".tmp")
    torch.onnx.export(
        network, (torch.zeros(1, 3, SIDE, SIDE),), str(plain), opset_version=OPSET, dynamo=False,
        input_names=["region"], output_names=["shares"], dynamic_axes={"region": {0: "places"}, "shares": {0: "places"}},
    )
    onnx.checker.check_model(onnx.load(str(plain)))
    write_compact(plain, target)
    plain.unlink()
    target.with_suffix(".json").write_text(json.dumps(card(state, steps(target)), indent=1) + "\n")
    about = content.pop("about", None)
    content["classifier"] = target.name
    if about is not None:
        content["about"] = about
    detector_card.write_text(json.dumps(content, indent=1) + "\n")
    print(f"{target}: {target.stat().st_size / 1e6:.2f} MB, named in {detector_card}")
