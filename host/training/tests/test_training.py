"""Rules that the training must keep; small enough to run in seconds."""

import json
import pathlib
import subprocess
import sys

import numpy
import pytest
import torch

from nearfield_training.backbone import FROZEN_STAGES, LiteBackbone, ScaledConvolution, SkippingFilter, published_weights
from nearfield_training.dataset import Augmentation, Sample, paste, resized, turned
from nearfield_training.export import card, head_layers, write_compact, write_hailo, write_onnx
from nearfield_training.loss import assign, complete_overlap, detection_loss
from nearfield_training.network import ANCHORS, STRIDES, Yolo
from nearfield_training.predict import boxes_of, letterbox, suppress

ROOT = pathlib.Path(__file__).parent.parent


def marked(rows: int, columns: int, left: int, top: int, right: int, bottom: int) -> Sample:
    """A black picture with a white box, so that a wrong label shows in the pixels."""
    picture = numpy.zeros((rows, columns, 3), numpy.uint8)
    picture[top:bottom, left:right] = 255
    return Sample(picture, numpy.array([[0, left, top, right, bottom]], numpy.float32))


def white_box(picture: numpy.ndarray) -> list[int]:
    """Where the white is."""
    rows, columns = numpy.nonzero(picture[:, :, 0] > 127)
    return [columns.min(), rows.min(), columns.max() + 1, rows.max() + 1]


@pytest.mark.parametrize("scale, millions", [("n", 1.87), ("s", 7.24), ("m", 21.19)])
def test_the_network_has_the_published_number_of_weights(scale, millions):
    count = sum(value.numel() for value in Yolo(scale, 80).parameters())
    assert count / 1e6 == pytest.approx(millions, abs=0.01)


def test_a_scaled_convolution_is_convolution_and_normalisation():
    torch.manual_seed(5)
    convolution, normalisation = torch.nn.Conv2d(6, 4, 3, 2, 1, bias=False), torch.nn.BatchNorm2d(4, eps=1e-3)
    for tensor in (normalisation.weight, normalisation.bias, normalisation.running_mean):
        torch.nn.init.normal_(tensor)
    normalisation.running_var.uniform_(0.1, 3)
    state = {f"c.{name}": value for name, value in convolution.state_dict().items()}
    state |= {f"n.{name}": value for name, value in normalisation.state_dict().items()}
    scaled = ScaledConvolution(6, 4, 3, 2, active=False)
    scaled.take(state, "c", "n")
    picture = torch.randn(2, 6, 16, 16)
    expected = normalisation.eval()(convolution(picture))
    assert torch.allclose(scaled(picture), expected, atol=1e-5)
    scaled.fold()
    scaled.fold()
    assert torch.allclose(scaled(picture), expected, atol=1e-5)


def test_the_backbone_takes_all_published_weights_and_sees_at_three_strides():
    backbone = LiteBackbone()
    for value in backbone.parameters():
        value.detach().fill_(float("nan"))
    backbone.take_published_weights()
    assert published_weights().suffix == ".pth"
    features = backbone(torch.rand(1, 3, 64, 96))
    assert [tuple(f.shape) for f in features] == [(1, 40, 8, 12), (1, 112, 4, 6), (1, 320, 2, 3)]
    assert all(torch.isfinite(f).all() for f in features)


def test_what_is_frozen_keeps_its_weights_and_the_rest_learns():
    network = Yolo("lite", 2)
    detection_loss(network, network(torch.rand(1, 3, 64, 64)), torch.tensor([[0.0, 1, 30, 30, 20, 20]]))[0].backward()
    for name, value in network.named_parameters():
        low = name.startswith(("backbone.stem.", *(f"backbone.stages.{stage}." for stage in range(FROZEN_STAGES))))
        first = name.startswith(f"backbone.stages.{FROZEN_STAGES}.0.expand.")
        frozen = low or first or (name.startswith("backbone.") and ".filter." in name)
        assert (value.grad is None) == frozen, name


@pytest.mark.parametrize(("rows", "columns", "side"), [(20, 12, 5), (10, 10, 3), (7, 9, 5)])
def test_the_quick_gradient_of_a_skipping_filter_is_the_gradient(rows, columns, side):
    x = torch.randn(2, 6, rows, columns, dtype=torch.double, requires_grad=True)
    kernel, offset = torch.randn(6, 1, side, side, dtype=torch.double), torch.randn(6, dtype=torch.double)
    usual = torch.nn.functional.conv2d(x, kernel, offset, 2, side // 2, 1, 6)
    quick = SkippingFilter.apply(x, kernel, offset)
    assert torch.equal(usual, quick)
    above = torch.randn_like(usual)
    (expected,), (found,) = torch.autograd.grad(usual, x, above), torch.autograd.grad(quick, x, above)
    assert torch.allclose(expected, found, atol=1e-12)


def test_an_object_belongs_to_its_cell_and_the_two_nearest_neighbours():
    anchors = torch.tensor(ANCHORS[0], dtype=torch.float32)
    # Centre at cell (5.25, 5.75): neighbours to the left and below. It is as large as the first anchor.
    targets = torch.tensor([[0.0, 2.0, 42.0, 46.0, 10.0, 13.0]])
    _, anchor, column, row = assign(targets, anchors, 8, 20, 20)
    cells = {(int(u), int(v)) for a, u, v in zip(anchor, column, row) if a == 0}
    assert cells == {(5, 5), (4, 5), (5, 6)}


def test_an_anchor_of_another_size_is_not_responsible():
    anchors = torch.tensor(ANCHORS[0], dtype=torch.float32)
    targets = torch.tensor([[0.0, 0.0, 80.0, 80.0, 4.1 * 33, 23.0]])
    assert len(assign(targets, anchors, 8, 40, 40)[0]) == 0


def test_no_cell_lies_outside():
    anchors = torch.tensor(ANCHORS[0], dtype=torch.float32)
    corners = [[0.0, 0.0, x, y, 12.0, 12.0] for x in (0.0, 159.9) for y in (0.0, 159.9)]
    _, _, column, row = assign(torch.tensor(corners), anchors, 8, 20, 20)
    assert column.min() >= 0 and row.min() >= 0 and column.max() < 20 and row.max() < 20


def test_complete_overlap_is_one_for_equal_boxes_and_falls_with_distance():
    box = torch.tensor([[50.0, 50.0, 20.0, 10.0]])
    complete, plain = complete_overlap(box, box)
    assert complete.item() == pytest.approx(1, abs=1e-4) and plain.item() == pytest.approx(1, abs=1e-4)
    near, far = (complete_overlap(box + torch.tensor([[d, 0.0, 0, 0]]), box)[0].item() for d in (30.0, 300.0))
    assert far < near < 0


def test_the_loss_falls_while_learning_one_picture():
    torch.manual_seed(3)
    network = Yolo("n", 3).train()
    picture = torch.rand(2, 3, 64, 64)
    targets = torch.tensor([[0.0, 1, 30, 30, 20, 20], [1.0, 2, 40, 20, 12, 30]])
    optimiser = torch.optim.AdamW(network.parameters(), lr=2e-3)
    losses = []
    for _ in range(25):
        loss, _ = detection_loss(network, network(picture), targets)
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
        losses.append(loss.item())
    assert losses[-1] < 0.7 * losses[0]


def test_pictures_without_objects_teach_too():
    network = Yolo("n", 3).train()
    loss, parts = detection_loss(network, network(torch.rand(1, 3, 64, 64)), torch.zeros(0, 6))
    assert torch.isfinite(loss) and parts[0] == 0 and parts[1] > 0


@pytest.mark.parametrize("quarters", range(4))
@pytest.mark.parametrize("mirrored", [False, True])
def test_labels_turn_with_the_picture(quarters, mirrored):
    sample = turned(marked(40, 60, 10, 5, 25, 12), quarters, mirrored)
    assert list(sample.boxes[0, 1:]) == white_box(sample.picture)


def test_labels_shrink_with_the_picture():
    sample = resized(marked(80, 120, 20, 40, 60, 60), 0.5)
    assert list(sample.boxes[0, 1:]) == white_box(sample.picture)


def test_what_is_cut_off_loses_its_label():
    canvas = numpy.zeros((50, 50, 3), numpy.uint8)
    whole = paste(canvas, (0, 0, 50, 50), marked(40, 40, 10, 10, 30, 30), (5, 5))
    assert whole.tolist() == [[0, 15, 15, 35, 35]]
    assert len(paste(canvas, (0, 0, 50, 50), marked(40, 40, 10, 10, 30, 30), (36, 5))) == 0


@pytest.mark.parametrize("seed", range(8))
def test_augmented_labels_lie_in_the_picture_and_chance_repeats(seed):
    samples = [marked(100 + 20 * index, 160, 20, 20, 70, 60) for index in range(5)]
    made = [Augmentation(samples, 96, 0.7, numpy.random.default_rng(seed))(seed % 5) for _ in range(2)]
    assert numpy.array_equal(made[0].picture, made[1].picture) and numpy.array_equal(made[0].boxes, made[1].boxes)
    assert made[0].picture.shape == (96, 96, 3)
    assert (made[0].boxes[:, 1:] >= 0).all() and (made[0].boxes[:, 1:] <= 96).all()


def test_suppression_keeps_the_best():
    boxes = numpy.array([[0, 0, 10, 10], [1, 0, 11, 10], [50, 0, 60, 10]], float)
    assert suppress(boxes, numpy.array([0.5, 0.9, 0.3]), 0.5) == [1, 2]


def test_boxes_come_back_from_the_letterbox():
    picture = marked(100, 200, 40, 20, 80, 60).picture
    planes, back = letterbox(picture, 64)
    inside = white_box((planes.transpose(1, 2, 0) * 255).astype(numpy.uint8))
    centre = [(inside[0] + inside[2]) / 2, (inside[1] + inside[3]) / 2, inside[2] - inside[0], inside[3] - inside[1]]
    found = boxes_of(numpy.array([[*centre, 1.0, 1.0]]), back, (200, 100), 0.5, 0.5)
    assert found[0, :4] == pytest.approx([40, 20, 80, 60], abs=3.2)


def test_the_exported_network_computes_the_same(tmp_path):
    import onnxruntime

    torch.manual_seed(5)
    network = Yolo("n", 3).eval()
    picture = torch.rand(1, 3, 64, 64)
    network.decoded = True
    expected = network(picture).detach().numpy()
    network.decoded = False
    write_onnx(network.fuse(), 64, tmp_path / "x.onnx", decoded=True)
    session = onnxruntime.InferenceSession(str(tmp_path / "x.onnx"))
    got = session.run(None, {"picture": picture.numpy()})[0]
    assert got.shape == (1, 3 * (64 + 16 + 4), 8)
    assert numpy.abs(got - expected).max() < 2e-3


def test_the_compact_network_computes_nearly_the_same_in_a_quarter_of_the_size(tmp_path):
    import onnxruntime

    torch.manual_seed(6)
    network = Yolo("n", 3).eval().fuse()
    write_onnx(network, 64, tmp_path / "x.onnx", decoded=True)
    write_compact(tmp_path / "x.onnx", tmp_path / "c.onnx")
    assert (tmp_path / "c.onnx").stat().st_size < 0.3 * (tmp_path / "x.onnx").stat().st_size
    picture = {"picture": torch.rand(1, 3, 64, 64).numpy()}
    plain, compact = (onnxruntime.InferenceSession(str(tmp_path / name)).run(None, picture)[0] for name in ("x.onnx", "c.onnx"))
    difference = numpy.abs(plain[..., 4:] - compact[..., 4:]).max()
    assert 0 < difference < 0.02


def test_hailos_files_name_the_three_outputs(tmp_path):
    network = Yolo("n", 3).eval().fuse()
    write_onnx(network, 64, tmp_path / "x.onnx", decoded=False)
    layers = head_layers(tmp_path / "x.onnx")
    assert len(set(layers)) == 3
    state = {"side": 64, "names": ["a", "b", "c"]}
    write_hailo(tmp_path / "x.onnx", state, tmp_path / "x.alls", tmp_path / "x-nms.json")
    content = json.loads((tmp_path / "x-nms.json").read_text())
    assert [decoder["stride"] for decoder in content["bbox_decoders"]] == list(STRIDES)
    assert [decoder["encoded_layer"] for decoder in content["bbox_decoders"]] == layers
    assert "x-nms.json" in (tmp_path / "x.alls").read_text()


def test_the_card_is_what_the_host_reads():
    content = card({"side": 320, "names": ["bolt", "hand"]}, "x", {})
    assert content["schema"] == "nearfield-detector-1" and len(content["operating_scores"]) == 2


def test_training_goes_on_after_a_kill(tmp_path):
    def python(*arguments: str) -> str:
        command = [sys.executable, "-m", "nearfield_training", *arguments]
        return subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True).stdout

    python("toy", "--out", str(tmp_path / "data"), "--images", "16", "--side", "64")
    train = ["train", "--data", str(tmp_path / "data"), "--out", str(tmp_path / "run"), "--side", "64", "--batch", "4"]
    python(*train, "--epochs", "1")
    assert "going on after epoch 1" in python(*train, "--epochs", "2")
    log = [json.loads(line) for line in (tmp_path / "run" / "log.jsonl").read_text().splitlines()]
    assert [entry["epoch"] for entry in log] == [1, 2]
    state = torch.load(tmp_path / "run" / "last.pt", weights_only=True)
    assert state["step"] == 8 and state["epoch"] == 2
