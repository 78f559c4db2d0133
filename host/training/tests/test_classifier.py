"""The classifier: what it learns from, and that the host reads what was trained."""

import json
import pathlib

import numpy
import onnxruntime
import pytest
import torch

from nearfield_training import classifier, export, export_classifier, regions, toy
from nearfield_training.classifier import SIDE, Classifier, Regions
from nearfield_training.dataset import Sample
from nearfield_training.network import Yolo

from test_promises import options_of

NAMES = ["washer", "hand"]


@pytest.mark.parametrize("seed", range(20))
def test_a_region_lies_in_the_picture_and_holds_its_box(seed):
    random = numpy.random.default_rng(seed)
    columns, rows = (int(value) for value in random.integers(1, 500, 2))
    corner = random.uniform(-20, 500, 2)
    box = numpy.concatenate([corner, corner + random.uniform(0, 300, 2)])
    left, top, right, bottom = regions.window(box, columns, rows)
    assert 0 <= left < right <= columns and 0 <= top < bottom <= rows
    if 0 <= box[0] and box[2] <= columns and 0 <= box[1] and box[3] <= rows:
        assert left <= box[0] and top <= box[1] and right >= box[2] and bottom >= box[3]


def test_places_are_named_by_what_they_fit_and_not_where_that_is_unclear():
    annotated = numpy.array([[1, 0, 0, 10, 10], [0, 50, 50, 60, 60]], float)
    found = numpy.array([[0, 0, 10, 11], [0, 0, 10, 24], [51, 50, 60, 60], [0, 0, 40, 40], [80, 80, 90, 90]], float)
    assert regions.labels(found, annotated, 2).tolist() == [1, -1, 0, 2, 2]
    assert regions.labels(found, annotated[:0], 2).tolist() == [2] * 5


def test_inputs_repeat_and_show_rare_classes_and_the_background():
    samples = [Sample(numpy.full((100, 120, 3), 90, numpy.uint8), numpy.zeros((0, 5)))]
    rows = numpy.array([[0, 0, 10, 10, 30, 30]] * 300 + [[0, 1, 50, 50, 60, 70]] * 10 + [[0, 2, 0, 0, 9, 9]] * 40, numpy.float32)
    inputs = Regions(samples, rows, 2, seed=1, epoch=0)
    shown = [inputs[index][1] for index in range(len(inputs))]
    assert len(inputs) == 310 and shown == [inputs[index][1] for index in range(len(inputs))]
    assert (inputs[5][0] == inputs[5][0]).all() and inputs[5][0].shape == (SIDE, SIDE, 3)
    assert shown.count(1) > 20, "ten of 310 by their number"
    assert 0.1 < shown.count(2) / len(shown) < 0.3


@pytest.fixture(scope="module")
def trained(tmp_path_factory) -> pathlib.Path:
    """A detector's files, and a classifier that was trained on what it finds, stopped and gone on with."""
    folder = tmp_path_factory.mktemp("classifier")
    toy.run(options_of(toy, "--out", folder / "data", "--images", "12", "--side", "64"))
    torch.manual_seed(3)
    state = {"names": NAMES, "scale": "lite", "side": 64, "epoch": 1, "seed": 1, "average": Yolo("lite", 2).state_dict()}
    torch.save(state, folder / "best.pt")
    export.run(options_of(export, "--weights", folder / "best.pt", "--out", folder / "files"))
    detector, data = folder / "files" / "detector.onnx", folder / "data"
    common = ["--detector", detector, "--data", data / "train", "--validate", data / "val", "--out", folder / "run", "--batch", "4"]
    for epochs in ("1", "2"):
        classifier.run(options_of(classifier, *common, "--backbone-of", detector, "--epochs", epochs))
    export_classifier.run(options_of(export_classifier, "--weights", folder / "run" / "last.pt", "--detector", detector))
    return folder


def test_training_goes_on_where_it_was_stopped(trained):
    log = [json.loads(line) for line in (trained / "run" / "log.jsonl").read_text().splitlines()]
    assert [entry["epoch"] for entry in log] == [1, 2]


def test_the_exported_classifier_computes_the_same_and_its_shares_make_one(trained):
    network, _ = export_classifier.load(trained / "run" / "last.pt")
    session = onnxruntime.InferenceSession(str(trained / "files" / "classifier.onnx"), providers=["CPUExecutionProvider"])
    inputs = torch.rand(1, 3, SIDE, SIDE, generator=torch.Generator().manual_seed(5))
    shares = session.run(None, {"region": inputs.numpy()})[0]
    assert shares.shape == (1, 1, 3) and abs(shares.sum() - 1) < 1e-5
    # Kernels are stored as bytes.
    assert numpy.abs(shares - network(inputs).detach().numpy()).max() < 0.05


def test_the_cards_name_each_other(trained):
    card = json.loads((trained / "files" / "classifier.json").read_text())
    assert card["schema"] == "nearfield-classifier-1" and card["classes"] == NAMES and card["steps"]
    assert json.loads((trained / "files" / "detector.json").read_text())["classifier"] == "classifier.onnx"


def test_a_classifier_of_other_classes_is_refused(trained):
    state = torch.load(trained / "run" / "best.pt", weights_only=True) | {"names": ["bolt"]}
    network = Classifier(1)
    torch.save(state | {"average": network.state_dict()}, trained / "other.pt")
    with pytest.raises(SystemExit, match="other classes"):
        export_classifier.run(
            options_of(export_classifier, "--weights", trained / "other.pt", "--detector", trained / "files" / "detector.onnx")
        )
