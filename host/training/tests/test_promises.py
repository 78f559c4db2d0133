"""What the README promises of the programs: files, options, and the cut that the host's default backend computes by."""

import argparse
import json
import pathlib

import numpy
import onnx
import onnxruntime
import pytest
import torch

from nearfield_training import calibration_set, cut, export, toy, train
from nearfield_training.dataset import read_coco
from nearfield_training.network import Yolo
from nearfield_training.predict import letterbox

SIDE = 64
NAMES = ["bolt", "hand", "other"]


def options_of(module, *arguments: str) -> argparse.Namespace:
    """A verb's options as the command line gives them."""
    parser = argparse.ArgumentParser()
    module.add_arguments(parser)
    return parser.parse_args([str(argument) for argument in arguments])


@pytest.fixture(scope="module")
def data(tmp_path_factory) -> pathlib.Path:
    """A toy dataset."""
    folder = tmp_path_factory.mktemp("data")
    toy.run(options_of(toy, "--out", folder, "--images", "12", "--side", SIDE))
    return folder


def untrained(scale: str) -> Yolo:
    """A network with random weights of a size that keeps its features alive: no package or network is needed."""
    torch.manual_seed(11)
    network = Yolo(scale, len(NAMES))
    with torch.no_grad():
        for name, value in network.named_parameters():
            if name.endswith("offset"):
                value.uniform_(-0.5, 1.5)
    return network.eval()


@pytest.fixture(scope="module", params=["lite", "n"])
def exported(request, tmp_path_factory, data) -> tuple[str, pathlib.Path]:
    """All files that `export` writes for one scale, from a checkpoint as `train` saves it."""
    folder = tmp_path_factory.mktemp("export")
    state = {"names": NAMES, "scale": request.param, "side": SIDE, "epoch": 3, "seed": 1}
    torch.save(state | {"average": untrained(request.param).state_dict()}, folder / "best.pt")
    out = folder / "files"
    export.run(options_of(export, "--weights", folder / "best.pt", "--out", out, "--data", data / "val", "--images", "4"))
    return request.param, out


def test_export_writes_every_file_that_its_table_names(exported):
    scale, out = exported
    networks = ["detector", "detector-compact", "detector-int8"]
    names = {f"{name}.{ending}" for name in networks for ending in ("onnx", "json")}
    assert {path.name for path in out.iterdir()} == names | {"detector-heads.onnx", "detector.alls", "detector-nms.json"}
    for name in networks:
        card = json.loads((out / f"{name}.json").read_text())
        assert (card["schema"], card["input_side"], card["classes"]) == ("nearfield-detector-1", SIDE, NAMES)
        assert card["about"]["architecture"] == export.ARCHITECTURES[scale]
        # Only a network with convolutions of single channels is cut; onnxruntime alone takes the one in bytes, and in one piece.
        assert ("steps" in card) == (scale == "lite" and name != "detector-int8")


def test_the_exported_files_compute_what_the_trained_network_computes(exported):
    scale, out = exported
    network, picture = untrained(scale), torch.rand(1, 3, SIDE, SIDE)
    network.decoded = True
    expected = network(picture).detach().numpy()
    assert numpy.ptp(expected[..., 4:]) > 0, "a dead network would agree with anything"
    bounds = {"detector": 2e-3, "detector-compact": 0.05, "detector-int8": 0.3}
    for name, bound in bounds.items():
        session = onnxruntime.InferenceSession(str(out / f"{name}.onnx"), providers=["CPUExecutionProvider"])
        got = session.run(None, {"picture": picture.numpy()})[0]
        assert got.shape == expected.shape
        assert numpy.abs(got[..., 4:] - expected[..., 4:]).max() < bound, name


def constants(model: onnx.ModelProto, names: list[str]) -> list[torch.Tensor]:
    """Tensors that no picture changes, kernels in bytes turned back."""
    parts = {tensor.name: onnx.numpy_helper.to_array(tensor) for tensor in model.graph.initializer}
    for node in model.graph.node:
        if node.op_type == "DequantizeLinear":
            values, scale = parts[node.input[0]].astype(numpy.float32), parts[node.input[1]]
            parts[node.output[0]] = values * scale.reshape(-1, *[1] * (values.ndim - 1))
    return [torch.tensor(parts[name]) for name in names]


def run_block(model: onnx.ModelProto, layer: dict, x: torch.Tensor) -> torch.Tensor:
    """What the host computes itself, by its definition in the card."""
    y = x
    if wide := layer.get("expand"):
        kernel, bias = constants(model, [wide["kernel"], wide["bias"]])
        y = torch.nn.functional.conv2d(y, kernel, bias).clamp(wide["low"], wide["high"])
    kernel, bias = constants(model, [layer["kernel"], layer["bias"]])
    y = torch.nn.functional.conv2d(y, kernel, bias, layer["stride"], kernel.shape[-1] // 2, groups=len(kernel))
    y = y.clamp(layer["low"], layer["high"])
    if narrow := layer.get("project"):
        kernel, bias = constants(model, [narrow["kernel"], narrow["bias"]])
        y = torch.nn.functional.conv2d(y, kernel, bias)
    return x + y if layer.get("shortcut") else y


def run_in_pieces(path: pathlib.Path, steps: list[dict], picture: numpy.ndarray) -> numpy.ndarray:
    """A network by its card's steps: every piece sees only what it takes."""
    model = onnx.shape_inference.infer_shapes(onnx.load(str(path)))
    complete = path.with_name("with-shapes.onnx")
    onnx.save(model, str(complete))
    known = {"picture": picture}
    for index, step in enumerate(steps):
        if step["gives"]:
            piece = path.with_name(f"piece-{index}.onnx")
            onnx.utils.extract_model(str(complete), str(piece), step["takes"], step["gives"])
            session = onnxruntime.InferenceSession(str(piece), providers=["CPUExecutionProvider"])
            known |= zip(step["gives"], session.run(step["gives"], {name: known[name] for name in step["takes"]}))
        if layer := step.get("depthwise"):
            known[layer["output"]] = run_block(model, layer, torch.tensor(known[layer["input"]])).numpy()
    return known["boxes"]


def test_a_network_cut_by_its_card_computes_the_same(exported, tmp_path):
    scale, out = exported
    if scale != "lite":
        pytest.skip("it has no convolutions of single channels")
    for name in ("detector", "detector-compact"):
        path = tmp_path / f"{name}.onnx"
        path.write_bytes((out / path.name).read_bytes())
        steps = json.loads((out / f"{name}.json").read_text())["steps"]
        layers = [step["depthwise"] for step in steps if "depthwise" in step]
        # The published network: sixteen blocks, of which all but the first begin by widening, and nine have a shortcut.
        assert len(layers) == 16 and all("project" in layer for layer in layers)
        assert sum("expand" in layer for layer in layers) == 15 and sum(layer.get("shortcut", False) for layer in layers) == 9
        picture = numpy.random.default_rng(2).random((1, 3, SIDE, SIDE), numpy.float32)
        whole = onnxruntime.InferenceSession(str(path), providers=["CPUExecutionProvider"]).run(None, {"picture": picture})[0]
        assert numpy.abs(run_in_pieces(path, steps, picture) - whole).max() < 2e-3


def test_cut_renews_the_steps_and_nothing_else(exported, tmp_path):
    scale, out = exported
    for ending in ("onnx", "json"):
        (tmp_path / f"x.{ending}").write_bytes((out / f"detector.{ending}").read_bytes())
    before = json.loads((tmp_path / "x.json").read_text())
    (tmp_path / "x.json").write_text(json.dumps(before | {"steps": [{"takes": ["old"], "gives": []}], "operating_scores": [0.1, 0.2, 0.3]}))
    cut.run(options_of(cut, "--model", tmp_path / "x.onnx"))
    assert json.loads((tmp_path / "x.json").read_text()) == before | {"operating_scores": [0.1, 0.2, 0.3]}
    assert ("steps" in before) == (scale == "lite")


def test_other_takes_all_that_has_no_class_of_its_own(data):
    content = json.loads((data / "train" / "annotations.json").read_text())
    kinds = [entry["name"] for entry in content["categories"]]
    counts = [sum(note["category_id"] == entry["id"] for note in content["annotations"]) for entry in content["categories"]]
    assert min(counts) > 0
    for names, expected in [([kinds[0], "other"], [counts[0], sum(counts[1:])]), (kinds[:1], counts[:1])]:
        classes = numpy.concatenate([sample.boxes[:, 0] for sample in read_coco(data / "train", names)]).astype(int)
        assert numpy.bincount(classes, minlength=len(names)).tolist() == expected


def test_the_calibration_set_is_inputs_in_bytes(data, tmp_path):
    calibration_set.run(options_of(calibration_set, "--data", data / "val", "--out", tmp_path / "c.npy", "--side", SIDE))
    array = numpy.load(tmp_path / "c.npy")
    pictures = read_coco(data / "val", NAMES)
    assert array.shape == (len(pictures), SIDE, SIDE, 3) and array.dtype == numpy.uint8
    assert numpy.abs(array[0].astype(int) - pictures[0].picture).max() <= 1, "of its own size a picture stays as it is, red first"


def test_training_begins_with_other_weights_and_ends_when_its_time_is_up(data, tmp_path, capsys):
    common = ["--data", data, "--side", SIDE, "--batch", "4", "--mosaic", "0"]
    train.run(options_of(train, *common, "--out", tmp_path / "one", "--epochs", "1"))
    files = {path.name for path in (tmp_path / "one").iterdir()}
    assert files == {"last.pt", "best.pt", "log.jsonl"}
    # A tiny share of a minute is used up by the first step; a thousand epochs would take hours.
    begin = ["--start-from", tmp_path / "one" / "best.pt", "--minutes", "0.0001", "--epochs", "1000"]
    train.run(options_of(train, *common, "--out", tmp_path / "two", *begin))
    said = capsys.readouterr().out
    own = len(Yolo("n", len(toy.NAMES)).state_dict())
    assert f"{own} of {own} tensors taken from" in said
    assert len((tmp_path / "two" / "log.jsonl").read_text().splitlines()) == 1


def test_training_begins_with_an_exported_network(exported, data, tmp_path, capsys):
    """What `export` wrote computes the same after the way back, and learns on: its normalisations have the right statistics."""
    scale, folder = exported
    options = ["--data", data, "--side", SIDE, "--batch", "4", "--mosaic", "0", "--scale", scale, "--epochs", "1"]
    begun = train.Run(options_of(train, *options, "--out", tmp_path / "run", "--start-from", folder / "detector.onnx"))
    begun._take_weights(begun.start_from, read_coco(data / "train", begun.names))
    network = begun.network.eval()
    network.decoded = True
    planes = torch.from_numpy(letterbox(read_coco(data / "val", NAMES)[0].picture, SIDE)[0])[None]
    session = onnxruntime.InferenceSession(str(folder / "detector.onnx"))
    expected = session.run(None, {"picture": planes.numpy()})[0]
    with torch.no_grad():
        found = network(planes).numpy()
    assert numpy.allclose(found, expected, rtol=1e-3, atol=2e-2)
    network.decoded = False
    train.run(options_of(train, *options, "--out", tmp_path / "run", "--start-from", folder / "detector.onnx"))
    assert "all weights taken from" in capsys.readouterr().out
    assert (tmp_path / "run" / "best.pt").exists()


def test_a_network_of_other_classes_is_refused_by_name(exported, data, tmp_path):
    scale, folder = exported
    options = ["--data", data, "--side", SIDE, "--scale", scale, "--classes", "square", "--out", tmp_path / "run"]
    with pytest.raises(SystemExit, match="heads.0.weight.*--classes"):
        train.run(options_of(train, *options, "--start-from", folder / "detector.onnx"))
