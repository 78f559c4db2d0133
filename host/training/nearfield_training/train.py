"""Training: AdamW, warm-up and cosine, moving average of the weights, a checkpoint after every epoch."""

import argparse
import copy
import json
import pathlib
import time

import numpy
import torch
from torch import nn
from torch.utils.data import DataLoader, Dataset
from tqdm import tqdm

from .dataset import Augmentation, Sample, class_names, read_coco
from .from_onnx import take
from .loss import detection_loss
from .network import SCALES, Yolo
from .schedule import Schedule, check_loss, prepare, save
from .validate import mean_average_precision

# A backbone that has learnt on ImageNet already learns on at this share of the rate.
BACKBONE_SHARE = 0.3
# In the last part of the training pictures are whole again, as they will be in use.
WITHOUT_MOSAIC = 0.25
# So many inputs tell the statistics of an exported network's features.
MEASURED, BATCH = 512, 16


class Inputs(Dataset):
    """Augmented inputs of one epoch; an input depends on seed, epoch and index only, not on who makes it."""

    def __init__(self, samples: list[Sample], side: int, mosaic: float, seed: int, epoch: int):
        self.samples, self.side, self.mosaic, self.seed, self.epoch = samples, side, mosaic, seed, epoch

    def __len__(self) -> int:
        return len(self.samples)

    def __getitem__(self, index: int) -> tuple[numpy.ndarray, numpy.ndarray]:
        random = numpy.random.default_rng([self.seed, self.epoch, index])
        sample = Augmentation(self.samples, self.side, self.mosaic, random)(index)
        return sample.picture, sample.boxes


def collate(batch: list[tuple[numpy.ndarray, numpy.ndarray]]) -> tuple[torch.Tensor, torch.Tensor]:
    """Bytes (batch, side, side, 3) and targets (picture, class, centre x, centre y, width, height)."""
    targets = []
    for index, (_, boxes) in enumerate(batch):
        rows = numpy.empty((len(boxes), 6), numpy.float32)
        rows[:, 0], rows[:, 1] = index, boxes[:, 0]
        rows[:, 2:4], rows[:, 4:6] = (boxes[:, 1:3] + boxes[:, 3:5]) / 2, boxes[:, 3:5] - boxes[:, 1:3]
        targets.append(rows)
    pictures = numpy.stack([picture for picture, _ in batch])
    return torch.from_numpy(pictures), torch.from_numpy(numpy.concatenate(targets))


def as_input(pictures: torch.Tensor) -> torch.Tensor:
    """From a batch's bytes, which lie as channels-last already, to what the network reads."""
    return pictures.permute(0, 3, 1, 2).float().div_(255)


class MovingAverage:
    """Weights averaged over the last steps; they are what is kept in the end."""

    def __init__(self, network: nn.Module):
        self.network = copy.deepcopy(network).eval()
        self.steps = 0

    @torch.no_grad()
    def update(self, network: nn.Module) -> None:
        """Takes in the weights after a step."""
        self.steps += 1
        decay = min(0.999, (1 + self.steps) / (10 + self.steps))
        for average, current in zip(self.network.parameters(), network.parameters()):
            average.lerp_(current, 1 - decay)
        for average, current in zip(self.network.buffers(), network.buffers()):
            average.copy_(current)


class Run:
    """One training and its directory: `last.pt` (everything to go on), `best.pt` (weights), `log.jsonl`."""

    def __init__(self, options: argparse.Namespace):
        self.options, self.out = options, options.out
        prepare(options)
        self.names = options.classes.split(",") if options.classes else class_names(options.data / "train")
        self.network = Yolo(options.scale, len(self.names)).to(memory_format=torch.channels_last)
        self.optimiser = torch.optim.AdamW(learning_groups(self.network), lr=options.rate, betas=(0.9, 0.99), fused=True)
        self.average = MovingAverage(self.network)
        self.schedule, self.best = Schedule(options), -1.0
        self.start_from: pathlib.Path | None = None
        if (self.out / "last.pt").exists() and not options.fresh:
            self._resume()
        elif options.start_from:
            self.start_from = options.start_from
        elif self.network.backbone is not None:
            self.network.backbone.take_published_weights()
            self.average = MovingAverage(self.network)
            print("the backbone begins with its ImageNet weights")

    def _resume(self) -> None:
        state = torch.load(self.out / "last.pt", weights_only=True)
        if state["names"] != self.names or state["scale"] != self.options.scale:
            raise SystemExit(f"{self.out}/last.pt is of another network; choose another --out or give --fresh")
        self.network.load_state_dict(state["network"])
        self.average.network.load_state_dict(state["average"])
        self.optimiser.load_state_dict(state["optimiser"])
        self.schedule.take(state)
        self.average.steps, self.best = state["step"], state["best"]
        print(f"going on after epoch {self.schedule.epoch} of {self.out}/last.pt")

    def _take_weights(self, path: pathlib.Path, train: list[Sample]) -> None:
        """Takes all weights that fit from a checkpoint, of other classes too; or everything from an exported network."""
        if path.suffix == ".onnx":
            inputs = Inputs(train, self.options.side, self.options.mosaic, self.options.seed, 0)
            batches = (range(first, min(first + BATCH, len(inputs))) for first in range(0, min(len(inputs), MEASURED), BATCH))
            take(self.network, path, (as_input(collate([inputs[index] for index in batch])[0]) for batch in batches))
            self.average = MovingAverage(self.network)
            print(f"all weights taken from {path}")
            return
        state, own = torch.load(path, weights_only=True)["average"], self.network.state_dict()
        fitting = {name: value for name, value in state.items() if name in own and value.shape == own[name].shape}
        self.network.load_state_dict(fitting, strict=False)
        self.average = MovingAverage(self.network)
        print(f"{len(fitting)} of {len(own)} tensors taken from {path}")

    def save(self) -> None:
        """Everything to go on after a kill."""
        state = {"names": self.names, "scale": self.options.scale, "side": self.options.side, "seed": self.options.seed}
        state |= {"network": self.network.state_dict(), "average": self.average.network.state_dict()}
        state |= {"optimiser": self.optimiser.state_dict(), "best": self.best}
        save(state | self.schedule.state(), self.out / "last.pt")

    def save_best(self) -> None:
        """Only the averaged weights and what is needed to use them."""
        state = {"names": self.names, "scale": self.options.scale, "side": self.options.side, "epoch": self.schedule.epoch}
        save(state | {"seed": self.options.seed, "average": self.average.network.state_dict()}, self.out / "best.pt")

    def train(self) -> None:
        """Until the epochs or the minutes are used up."""
        options = self.options
        train = read_coco(options.data / "train", self.names, options.limit)
        validation = read_coco(options.data / "val", self.names, options.validate)
        print(f"{len(train)} pictures to learn from, {len(validation)} to validate, {len(self.names)} classes")
        if self.start_from:
            self._take_weights(self.start_from, train)
        schedule = self.schedule
        schedule.steps_in_all = len(train) // options.batch * options.epochs
        while schedule.goes_on():
            losses = self._one_epoch(train)
            schedule.epoch += 1
            start = time.monotonic()
            at_50, at_all, by_class = mean_average_precision(copy.deepcopy(self.average.network), validation, options.side)
            schedule.seconds += time.monotonic() - start
            better = at_50 + at_all > self.best
            self.best = max(self.best, at_50 + at_all)
            entry = {"epoch": schedule.epoch, "box": losses[0], "objectness": losses[1], "class": losses[2]}
            entry |= {"mAP50": round(at_50, 4), "mAP": round(at_all, 4), "seconds": round(schedule.seconds)}
            entry["AP50"] = {name: round(value, 3) for name, value in zip(self.names, by_class)}
            with (self.out / "log.jsonl").open("a") as log:
                log.write(json.dumps(entry) + "\n")
            print({key: value for key, value in entry.items() if key != "AP50"}, flush=True)
            self.save()
            if better:
                self.save_best()

    def _one_epoch(self, train: list[Sample]) -> list[float]:
        options = self.options
        mosaic = 0.0 if self.schedule.progress() > 1 - WITHOUT_MOSAIC else options.mosaic
        inputs = Inputs(train, options.side, mosaic, options.seed, self.schedule.epoch)
        order = torch.Generator().manual_seed(options.seed * 100_003 + self.schedule.epoch)
        loader = DataLoader(
            inputs, options.batch, shuffle=True, drop_last=True, generator=order, collate_fn=collate,
            num_workers=options.workers,
        )
        total = torch.zeros(3)
        self.network.train()
        bar = tqdm(loader, desc=f"epoch {self.schedule.epoch + 1}", mininterval=5, dynamic_ncols=True)
        done = 0
        self.schedule.begin_epoch()
        for pictures, targets in bar:
            total += self._one_step(pictures, targets)
            done += 1
            self.schedule.count_step()
            if self.schedule.progress() >= 1:
                break
        return [round(float(value), 4) for value in total / max(1, done)]

    def _one_step(self, pictures: torch.Tensor, targets: torch.Tensor) -> torch.Tensor:
        self.schedule.set_rate(self.optimiser)
        inputs = as_input(pictures)
        with torch.autocast("cpu", dtype=torch.bfloat16):
            outputs = self.network(inputs)
        loss, parts = detection_loss(self.network, outputs, targets)
        check_loss(loss, self.schedule.step)
        self.optimiser.zero_grad(set_to_none=True)
        loss.backward()
        torch.nn.utils.clip_grad_norm_(self.network.parameters(), 10.0)
        self.optimiser.step()
        self.average.update(self.network)
        return parts


def learning_groups(network: nn.Module) -> list[dict]:
    """What learns: kernels with weight decay, offsets and factors without; a backbone slower than the rest."""
    groups = []
    for in_backbone, share in ((False, 1.0), (True, BACKBONE_SHARE)):
        values = [
            value for name, value in network.named_parameters()
            if value.requires_grad and name.startswith("backbone.") == in_backbone
        ]
        for kernels, decay in ((True, 0.02), (False, 0.0)):
            chosen = [value for value in values if (value.ndim > 1) == kernels]
            if chosen:
                groups.append({"params": chosen, "weight_decay": decay, "share": share})
    return groups


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of `train`."""
    parser.add_argument("--data", type=pathlib.Path, required=True, help="folder with train/ and val/, COCO each")
    parser.add_argument("--out", type=pathlib.Path, required=True, help="checkpoints and log; goes on if there are any")
    parser.add_argument("--scale", choices=sorted(SCALES), default="n", help="size of the network")
    parser.add_argument("--side", type=int, default=320, help="side of the input, pixels")
    parser.add_argument("--epochs", type=int, default=50)
    parser.add_argument("--minutes", type=float, default=0, help="end earlier, after this time; 0: no limit")
    parser.add_argument("--batch", type=int, default=16)
    parser.add_argument("--rate", type=float, default=2e-3, help="peak learning rate")
    parser.add_argument("--mosaic", type=float, default=0.7, help="share of inputs made of four pictures")
    parser.add_argument("--classes", default="", help="names, comma between; \"other\" takes all that are not named; default: all of train/")
    parser.add_argument("--limit", type=int, default=0, help="use only so many pictures; 0: all")
    parser.add_argument("--validate", type=int, default=300, help="validate on so many pictures; 0: all")
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--workers", type=int, default=0, help="processes that prepare inputs")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--fresh", action="store_true", help="begin anew although there are checkpoints")
    parser.add_argument("--start-from", type=pathlib.Path, help="weights to begin with: a best.pt, or an ONNX file of `export`")


def run(options: argparse.Namespace) -> None:
    """Trains."""
    Run(options).train()
