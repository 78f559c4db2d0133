"""From weights to files: ONNX for the host (float and int8), its card, and what Hailo's compiler needs.

| file | for |
|---|---|
| NAME.onnx, NAME.json | the host: network with decoded boxes, and its card |
| NAME-compact.onnx | the same in a quarter of the size: kernels are stored as bytes and computed with as floats |
| NAME-int8.onnx | the host's backend onnxruntime: weights and features of the convolutions in 8 bits |
| NAME-heads.onnx | Hailo's parser: the three outputs without the arithmetic behind them |
| NAME.alls, NAME-nms.json | Hailo's compiler: model script, and boxes and suppression on the Pi |
"""

import argparse
import json
import pathlib

import numpy
import onnx
import torch

from .cut import steps
from .dataset import class_names, read_coco
from .network import ANCHORS, STRIDES, Yolo
from .predict import letterbox

OPSET = 13
# How a network's card names what it is.
ARCHITECTURES = {scale: f"YOLOv5 version 6, {scale}" for scale in ("n", "s", "m")}
ARCHITECTURES["lite"] = "EfficientNet-Lite0 (began with TensorFlow's weights, Apache-2.0) and the neck and heads of YOLOv5 version 6, n"
# A first guess; `nearfield evaluate --write-card` replaces it by one fitted on the validation pictures.
FIRST_OPERATING_SCORE = 0.4
LARGEST_OVERLAP = 0.5


def load(path: pathlib.Path) -> tuple[Yolo, dict]:
    """The averaged weights of a checkpoint, ready for use."""
    state = torch.load(path, weights_only=True)
    network = Yolo(state["scale"], len(state["names"]))
    network.load_state_dict(state["average"])
    return network.eval().fuse(), state


def write_onnx(network: Yolo, side: int, path: pathlib.Path, decoded: bool) -> None:
    """One ONNX file for one picture at a time."""
    network.decoded = decoded
    names = ["boxes"] if decoded else [f"stride_{stride}" for stride in STRIDES]
    torch.onnx.export(
        network, (torch.zeros(1, 3, side, side),), str(path), opset_version=OPSET, dynamo=False,
        input_names=["picture"], output_names=names,
    )
    network.decoded = False
    onnx.checker.check_model(onnx.load(str(path)))


def write_compact(source: pathlib.Path, target: pathlib.Path) -> None:
    """The same network with its kernels as bytes, a scale for each output channel: a quarter of the size.

    They are turned back into floats when the network is loaded; only the rounding of the kernels remains.
    """
    model = onnx.load(str(source))
    graph = model.graph
    kernels = {node.input[1] for node in graph.node if node.op_type == "Conv"}
    kept, nodes = [], []
    for tensor in graph.initializer:
        if tensor.name not in kernels:
            kept.append(tensor)
            continue
        values = onnx.numpy_helper.to_array(tensor)
        scale = numpy.abs(values).reshape(len(values), -1).max(1).clip(1e-12) / 127
        rounded = numpy.round(values / scale[:, None, None, None]).astype(numpy.int8)
        parts = {"bytes": rounded, "scale": scale.astype(numpy.float32), "zero": numpy.zeros(len(values), numpy.int8)}
        names = [f"{tensor.name}.{part}" for part in parts]
        kept += [onnx.numpy_helper.from_array(value, name) for name, value in zip(names, parts.values())]
        nodes.append(onnx.helper.make_node("DequantizeLinear", names, [tensor.name], axis=0))
    nodes += list(graph.node)
    del graph.initializer[:], graph.node[:]
    graph.initializer.extend(kept)
    graph.node.extend(nodes)
    onnx.checker.check_model(model)
    onnx.save(model, str(target))


def card(state: dict, name: str, about: dict) -> dict:
    """What the host must know."""
    return {
        "schema": "nearfield-detector-1",
        "name": name,
        "input_side": state["side"],
        "classes": state["names"],
        "largest_overlap": LARGEST_OVERLAP,
        "operating_scores": [FIRST_OPERATING_SCORE] * len(state["names"]),
        "calibration": {"slope": 1.0, "intercept": 0.0},
        "about": about,
    }


def write_int8(source: pathlib.Path, target: pathlib.Path, inputs: list[numpy.ndarray]) -> None:
    """Convolutions in 8 bits, ranges from these inputs; the arithmetic behind the outputs stays in floats."""
    from onnxruntime.quantization import CalibrationDataReader, QuantFormat, QuantType, quantize_static

    class Reader(CalibrationDataReader):
        """Gives one input after the other."""

        def __init__(self):
            self.iterator = iter(inputs)

        def get_next(self):
            """The next input, or nothing."""
            planes = next(self.iterator, None)
            return None if planes is None else {"picture": planes[None]}

    quantize_static(
        str(source), str(target), Reader(), quant_format=QuantFormat.QDQ, per_channel=True,
        op_types_to_quantize=["Conv"], activation_type=QuantType.QUInt8, weight_type=QuantType.QInt8,
    )


def head_layers(path: pathlib.Path) -> list[str]:
    """Hailo's parser numbers convolutions in the order of the graph: the names of those that are outputs."""
    graph = onnx.load(str(path)).graph
    producers = {name: node for node in graph.node for name in node.output}
    convolutions = [node.output[0] for node in graph.node if node.op_type == "Conv"]
    layers = []
    for output in graph.output:
        name = output.name
        while name not in convolutions:
            name = producers[name].input[0]
        layers.append(f"conv{convolutions.index(name) + 1}")
    return layers


def write_hailo(heads: pathlib.Path, state: dict, script: pathlib.Path, suppression: pathlib.Path) -> None:
    """Model script and suppression's configuration for Hailo's compiler."""
    side = state["side"]
    decoders = [
        {
            "name": f"bbox_decoder_{stride}", "stride": stride, "encoded_layer": layer,
            "w": [anchor[0] for anchor in anchors], "h": [anchor[1] for anchor in anchors],
        }
        for stride, anchors, layer in zip(STRIDES, ANCHORS, head_layers(heads))
    ]
    content = {
        "nms_scores_th": 0.05, "nms_iou_th": LARGEST_OVERLAP, "image_dims": [side, side], "max_proposals_per_class": 80,
        "classes": len(state["names"]), "regression_length": 4, "background_removal": False,
        "background_removal_index": 0, "bbox_decoders": decoders,
    }
    suppression.write_text(json.dumps(content, indent=2) + "\n")
    script.write_text(
        "normalization1 = normalization([0.0, 0.0, 0.0], [255.0, 255.0, 255.0])\n"
        "model_optimization_config(calibration, batch_size=8, calibset_size=1024)\n"
        f'nms_postprocess("{suppression.name}", meta_arch=yolov5, engine=cpu)\n'
    )


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of `export`."""
    parser.add_argument("--weights", type=pathlib.Path, required=True, help="best.pt or last.pt")
    parser.add_argument("--out", type=pathlib.Path, required=True, help="folder for the files")
    parser.add_argument("--name", default="detector", help="first part of the files' names")
    parser.add_argument("--data", type=pathlib.Path, help="COCO folder for the ranges of int8; without: no int8")
    parser.add_argument("--images", type=int, default=200, help="pictures for the ranges")


def run(options: argparse.Namespace) -> None:
    """Writes all files."""
    options.out.mkdir(parents=True, exist_ok=True)
    network, state = load(options.weights)
    plain, heads = options.out / f"{options.name}.onnx", options.out / f"{options.name}-heads.onnx"
    write_onnx(network, state["side"], plain, decoded=True)
    write_onnx(network, state["side"], heads, decoded=False)
    write_hailo(heads, state, options.out / f"{options.name}.alls", options.out / f"{options.name}-nms.json")
    compact = options.out / f"{options.name}-compact.onnx"
    write_compact(plain, compact)
    about = {"architecture": ARCHITECTURES[state["scale"]], "epochs": state["epoch"], "seed": state["seed"]}
    for path in (plain, compact):
        content = card(state, path.stem, about)
        if cut := steps(path):
            content["steps"] = cut
        path.with_suffix(".json").write_text(json.dumps(content, indent=2) + "\n")
    if options.data:
        samples = read_coco(options.data, class_names(options.data), options.images)
        inputs = [letterbox(sample.picture, state["side"])[0] for sample in samples]
        write_int8(plain, options.out / f"{options.name}-int8.onnx", inputs)
        other = card(state, f"{options.name}-int8", about)
        (options.out / f"{options.name}-int8.json").write_text(json.dumps(other, indent=2) + "\n")
    for path in sorted(options.out.glob(f"{options.name}*")):
        print(f"{path}: {path.stat().st_size / 1e6:.2f} MB")
