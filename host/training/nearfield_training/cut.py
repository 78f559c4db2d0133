"""A network cut at its convolutions of single channels: for the host's default backend, which computes these itself.

Where such a convolution stands between one that makes features wide and one that makes them narrow again, the three are one
block (an inverted bottleneck, with or without a shortcut): the host takes it through its cache band by band.
"""

import argparse
import json
import pathlib

import onnx


class Graph:
    """A network's arithmetic, without what no picture changes."""

    def __init__(self, path: pathlib.Path):
        self.graph = onnx.load(str(path)).graph
        constants = {tensor.name for tensor in self.graph.initializer}
        self.nodes: list[onnx.NodeProto] = []
        self.producer: dict[str, onnx.NodeProto] = {}
        self.users: dict[str, list[onnx.NodeProto]] = {}
        for node in self.graph.node:
            if all(name in constants for name in node.input if name):
                constants.update(node.output)
                continue
            self.nodes.append(node)
            self.producer.update({name: node for name in node.output})
            for name in node.input:
                self.users.setdefault(name, []).append(node)

    def only_user(self, name: str, kind: str) -> onnx.NodeProto | None:
        """The node that uses a tensor, if it is the only one and of this kind."""
        found = self.users.get(name, [])
        is_output = any(name == entry.name for entry in self.graph.output)
        return found[0] if len(found) == 1 and found[0].op_type == kind and not is_output else None

    def limits(self, clip: onnx.NodeProto) -> dict[str, float]:
        """Between which a node keeps its numbers."""
        low, high = (self._scalar(name) for name in clip.input[1:3])
        return {"low": low, "high": high}

    def _scalar(self, name: str) -> float:
        for tensor in self.graph.initializer:
            if tensor.name == name:
                return float(onnx.numpy_helper.to_array(tensor))
        for node in self.graph.node:
            if name in node.output and node.op_type == "Constant":
                return float(onnx.numpy_helper.to_array(node.attribute[0].t))
        raise SystemExit(f"the limit {name} is no constant")


def attributes(node: onnx.NodeProto) -> dict:
    """A node's settings."""
    return {entry.name: onnx.helper.get_attribute_value(entry) for entry in node.attribute}


def is_pointwise(node: onnx.NodeProto | None) -> bool:
    """Is it a convolution of single pixels, with a bias?"""
    if node is None or node.op_type != "Conv" or len(node.input) != 3:
        return False
    settings = attributes(node)
    plain = settings.get("group", 1) == 1 and set(settings.get("strides", [1])) == {1} and not any(settings.get("pads", [0]))
    return plain and set(settings["kernel_shape"]) == {1}


def block(graph: Graph, node: onnx.NodeProto) -> tuple[dict, list[onnx.NodeProto]]:
    """What is computed around a convolution of single channels, and all nodes that this replaces."""
    layer = {"input": node.input[0], "output": node.output[0], "kernel": node.input[1], "bias": node.input[2]}
    layer |= {"stride": attributes(node)["strides"][0], "low": -3e38, "high": 3e38}
    replaced = [node]
    if clip := graph.only_user(node.output[0], "Clip"):
        layer |= {"output": clip.output[0]} | graph.limits(clip)
        replaced.append(clip)
    clip = graph.producer.get(node.input[0])
    wide = graph.producer.get(clip.input[0]) if clip is not None and clip.op_type == "Clip" else None
    if is_pointwise(wide) and graph.only_user(clip.output[0], "Conv") and graph.only_user(wide.output[0], "Clip"):
        layer["expand"] = {"kernel": wide.input[1], "bias": wide.input[2]} | graph.limits(clip)
        layer["input"] = wide.input[0]
        replaced += [wide, clip]
    narrow = graph.only_user(layer["output"], "Conv")
    if is_pointwise(narrow):
        layer["project"] = {"kernel": narrow.input[1], "bias": narrow.input[2]}
        layer["output"] = narrow.output[0]
        replaced.append(narrow)
        total = graph.only_user(narrow.output[0], "Add")
        if total and set(total.input) == {narrow.output[0], layer["input"]}:
            layer |= {"output": total.output[0], "shortcut": True}
            replaced.append(total)
    return layer, replaced


def steps(path: pathlib.Path) -> list[dict]:
    """The pieces between the blocks, in the file's order; each takes and gives the tensors that cross its ends."""
    graph = Graph(path)
    layers, replaced = {}, set()
    for node in graph.nodes:
        if node.op_type == "Conv" and attributes(node).get("group", 1) > 1:
            layers[node.output[0]], nodes = block(graph, node)
            replaced |= {other.output[0] for other in nodes}
    if not layers:
        return []
    pieces, origin = [{"nodes": [], "depthwise": None}], {entry.name: -1 for entry in graph.graph.input}
    for node in graph.nodes:
        if node.output[0] in layers:
            pieces[-1]["depthwise"] = layers[node.output[0]]
            # Known behind this piece, as if the next one had been told it.
            origin[layers[node.output[0]]["output"]] = len(pieces) - 0.5
            pieces.append({"nodes": [], "depthwise": None})
        elif node.output[0] not in replaced:
            pieces[-1]["nodes"].append(node)
            origin.update({name: len(pieces) - 1 for name in node.output})
    takes: list[dict] = [{} for _ in pieces]
    gives: list[dict] = [{} for _ in pieces]
    for index, piece in enumerate(pieces):
        wanted = [name for node in piece["nodes"] for name in node.input if name in origin and origin[name] != index]
        takes[index] = dict.fromkeys(wanted)
        for name in wanted + ([piece["depthwise"]["input"]] if piece["depthwise"] else []):
            # The picture and what a block computed are known without a piece that gives them.
            if origin[name] in range(len(pieces)):
                gives[int(origin[name])][name] = None
    for entry in graph.graph.output:
        if origin[entry.name] in range(len(pieces)):
            gives[int(origin[entry.name])][entry.name] = None
    answer = []
    for piece, taken, given in zip(pieces, takes, gives):
        entry = {"takes": list(taken), "gives": list(given)}
        answer.append(entry | ({"depthwise": piece["depthwise"]} if piece["depthwise"] else {}))
    return answer


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of `cut`."""
    parser.add_argument("--model", type=pathlib.Path, required=True, help="an ONNX file with its card beside it")


def run(options: argparse.Namespace) -> None:
    """Writes the steps into the card beside the network; everything else in it stays."""
    path = options.model.with_suffix(".json")
    card = json.loads(path.read_text())
    card.pop("steps", None)
    about = card.pop("about", None)
    if cut := steps(options.model):
        card["steps"] = cut
    if about is not None:
        card["about"] = about
    path.write_text(json.dumps(card, indent=1) + "\n")
    print(f"{path}: {len(card.get('steps', []))} pieces")
