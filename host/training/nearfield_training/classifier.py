"""A classifier of regions: what is it that the detector found there?

Half of a detector's errors are names: small things at the right place are called something else, for the detector sees them
shrunk, and learns their names from a few cells of each picture. A network that sees nothing but the place, in the picture's
own resolution, and learns nothing but names, tells them better. The host mixes both opinions.
"""

import argparse
import json
import pathlib

import numpy
import torch
from torch import nn
from torch.utils.data import DataLoader, Dataset
from tqdm import tqdm

from .backbone import CHANNELS, LiteBackbone
from .dataset import Sample, degrade, read_coco
from .from_onnx import take_backbone
from .regions import collect, region
from .schedule import Schedule, check_loss, prepare, save
from .train import MovingAverage, as_input, learning_groups

SIDE = 64
# So many inputs show what is no object.
BACKGROUND_SHARE = 0.2
# Rare classes are shown more often than they occur: by this power of how often they do.
RARITY = 0.4
# Boxes are moved and scaled by about this share of their size: those of another picture fit as badly.
JITTER = 0.06
DROPPED, SMOOTHING = 0.2, 0.05
QUARTER_TURNS = 0.4
# So many inputs are changed in light, sharpness and noise: a small thing's few pixels bear less of that than a picture does.
DEGRADED = 0.5
# So many inputs tell the features' statistics.
MEASURED = 1024


class Classifier(nn.Module):
    """Regions (batch, 3, side, side), 0 to 1, to a number for each class and one for the background."""

    def __init__(self, classes: int):
        super().__init__()
        self.backbone = LiteBackbone()
        # Features of the three strides differ in size by orders of magnitude. Their statistics are measured once, at the beginning:
        # were they followed, nothing would hold the features, and they drift until the last stages are saturated and dead.
        self.level = nn.BatchNorm1d(sum(CHANNELS), affine=False)
        self.drop = nn.Dropout(DROPPED)
        self.name = nn.Linear(sum(CHANNELS), classes + 1)
        self.shares = False

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """Logits (batch, classes + 1); with `shares` as the host reads them: (batch, 1, classes + 1), 1 in sum."""
        fine, middle, coarse = self.backbone(x)
        features = torch.cat([fine.amax((2, 3)), middle.amax((2, 3)), coarse.mean((2, 3))], 1)
        logits = self.name(self.drop(self.level(features.float())))
        return logits.softmax(1)[:, None] if self.shares else logits


class Regions(Dataset):
    """Augmented inputs; an input depends on seed, epoch and index only, not on who makes it."""

    def __init__(self, samples: list[Sample], rows: numpy.ndarray, classes: int, seed: int, epoch: int):
        self.samples, self.rows, self.classes, self.seed, self.epoch = samples, rows, classes, seed, epoch
        shown = rows[:, 1].astype(int)
        often = numpy.bincount(shown, minlength=classes + 1).clip(1).astype(float)
        weights = often[shown] ** -RARITY
        is_background = shown == classes
        for part, share in ((is_background, BACKGROUND_SHARE), (~is_background, 1 - BACKGROUND_SHARE)):
            weights[part] *= share / max(weights[part].sum(), 1e-12)
        self.until = numpy.cumsum(weights / weights.sum())

    def __len__(self) -> int:
        return int((self.rows[:, 1] < self.classes).sum())

    def __getitem__(self, index: int) -> tuple[numpy.ndarray, int]:
        random = numpy.random.default_rng([self.seed, self.epoch, index])
        row = self.rows[min(int(numpy.searchsorted(self.until, random.random())), len(self.rows) - 1)]
        box = row[2:].astype(float)
        size = max(box[2] - box[0], box[3] - box[1])
        box += numpy.tile(random.normal(0, JITTER, 2) * size, 2)
        box += numpy.array([-1, -1, 1, 1]) * size / 2 * random.normal(0, JITTER)
        planes = region(self.samples[int(row[0])].picture, box, SIDE)
        picture = (planes.transpose(1, 2, 0) * 255).round().astype(numpy.uint8)
        if random.random() < QUARTER_TURNS:
            picture = numpy.rot90(picture, int(random.integers(4)))
        if random.random() < 0.5:
            picture = picture[:, ::-1]
        picture = numpy.ascontiguousarray(picture)
        if random.random() < DEGRADED:
            picture = degrade(picture, numpy.array([[0, SIDE * 0.2, SIDE * 0.2, SIDE * 0.8, SIDE * 0.8]]), random)
        return picture, int(row[1])


class Run:
    """One training and its directory: `last.pt` (everything to go on), `best.pt` (weights), `log.jsonl`."""

    def __init__(self, options: argparse.Namespace):
        self.options, self.out = options, options.out
        prepare(options)
        self.names = json.loads(options.detector.with_suffix(".json").read_text())["classes"]
        self.network = Classifier(len(self.names)).to(memory_format=torch.channels_last)
        self.schedule, self.best = Schedule(options), -1.0
        resumed = (self.out / "last.pt").exists() and not options.fresh
        if not resumed and options.start_from:
            self.network.load_state_dict(torch.load(options.start_from, weights_only=True)["average"])
        elif not resumed and options.backbone_of:
            take_backbone(self.network.backbone, options.backbone_of)
        elif not resumed:
            self.network.backbone.take_published_weights()
        self.optimiser = torch.optim.AdamW(learning_groups(self.network), lr=options.rate, betas=(0.9, 0.99), fused=True)
        self.average = MovingAverage(self.network)
        if resumed:
            self._resume()

    def _resume(self) -> None:
        state = torch.load(self.out / "last.pt", weights_only=True)
        if state["names"] != self.names:
            raise SystemExit(f"{self.out}/last.pt has other classes; choose another --out or give --fresh")
        self.network.load_state_dict(state["network"])
        self.average.network.load_state_dict(state["average"])
        self.optimiser.load_state_dict(state["optimiser"])
        self.schedule.take(state)
        self.average.steps, self.best = state["step"], state["best"]
        print(f"going on after epoch {self.schedule.epoch} of {self.out}/last.pt")

    def save(self, better: bool) -> None:
        """Everything to go on after a kill, and the weights if they are the best."""
        state = {"names": self.names, "average": self.average.network.state_dict(), "best": self.best} | self.schedule.state()
        save(state | {"network": self.network.state_dict(), "optimiser": self.optimiser.state_dict()}, self.out / "last.pt")
        if better:
            save(state, self.out / "best.pt")

    def _rows(self, name: str, samples: list[Sample], annotations: bool) -> numpy.ndarray:
        """The detector needs minutes for all pictures: kept beside the checkpoints."""
        path, options = self.out / f"{name}.npy", self.options
        if path.exists():
            return numpy.load(path)
        rows = collect(samples, options.detector, len(self.names), options.threads, annotations)
        numpy.save(path, rows)
        return rows

    def train(self) -> None:
        """Until the epochs or the minutes are used up."""
        options = self.options
        parts = [read_coco(folder, self.names) for folder in options.data]
        samples = [sample for part in parts for sample in part]
        validation = read_coco(options.validate, self.names)
        rows = self._rows("learnt", samples, True)
        judged = self._rows("judged", validation, False)
        inputs = Regions(samples, rows, len(self.names), options.seed, 0)
        print(f"{len(rows)} places in {len(samples)} pictures to learn from, {len(inputs)} of them with an object")
        schedule = self.schedule
        schedule.steps_in_all = len(inputs) // options.batch * options.epochs
        if schedule.step == 0 and not options.start_from:
            self._measure(inputs)
        while schedule.goes_on():
            loss = self._one_epoch(Regions(samples, rows, len(self.names), options.seed, schedule.epoch))
            schedule.epoch += 1
            right, no_object = self._judge(validation, judged)
            better = right + no_object > self.best
            self.best = max(self.best, right + no_object)
            entry = {"epoch": schedule.epoch, "loss": round(loss, 4), "objects_right": round(right, 4)}
            entry |= {"background_right": round(no_object, 4), "seconds": round(schedule.seconds)}
            with (self.out / "log.jsonl").open("a") as log:
                log.write(json.dumps(entry) + "\n")
            print(entry, flush=True)
            self.save(better)

    def _one_epoch(self, inputs: Regions) -> float:
        options = self.options
        loader = DataLoader(inputs, options.batch, drop_last=True, num_workers=options.workers)
        self.network.train()
        self.network.level.eval()
        total, done = 0.0, 0
        self.schedule.begin_epoch()
        for pictures, shown in tqdm(loader, desc=f"epoch {self.schedule.epoch + 1}", mininterval=5, dynamic_ncols=True):
            total += self._one_step(pictures, shown)
            done += 1
            self.schedule.count_step()
            if self.schedule.progress() >= 1:
                break
        return total / max(1, done)

    def _one_step(self, pictures: torch.Tensor, shown: torch.Tensor) -> float:
        self.schedule.set_rate(self.optimiser)
        with torch.autocast("cpu", dtype=torch.bfloat16):
            logits = self.network(as_input(pictures))
        loss = nn.functional.cross_entropy(logits.float(), shown, label_smoothing=SMOOTHING)
        check_loss(loss, self.schedule.step)
        self.optimiser.zero_grad(set_to_none=True)
        loss.backward()
        torch.nn.utils.clip_grad_norm_(self.network.parameters(), 10.0)
        self.optimiser.step()
        self.average.update(self.network)
        return float(loss.detach())

    @torch.no_grad()
    def _measure(self, inputs: Regions) -> None:
        """The features' statistics before anything is learnt."""
        self.network.eval()
        level = self.network.level
        level.momentum = None  # the mean over all that comes
        level.train()
        for first in range(0, min(MEASURED, len(inputs)), self.options.batch):
            last = min(first + self.options.batch, len(inputs))
            self.network(as_input(torch.from_numpy(numpy.stack([inputs[index][0] for index in range(first, last)]))))
        self.average = MovingAverage(self.network)

    @torch.no_grad()
    def _judge(self, samples: list[Sample], rows: numpy.ndarray) -> tuple[float, float]:
        """Shares of the detector's places that are named rightly: those with an object, and those without."""
        right = [numpy.zeros(0, bool)]
        for first in range(0, len(rows), 256):
            chosen = rows[first : first + 256]
            inputs = numpy.stack([region(samples[int(row[0])].picture, row[2:], SIDE) for row in chosen])
            with torch.autocast("cpu", dtype=torch.bfloat16):
                logits = self.average.network(torch.from_numpy(inputs).contiguous(memory_format=torch.channels_last))
            right.append(logits.argmax(1).numpy() == chosen[:, 1])
        right, is_object = numpy.concatenate(right), rows[:, 1] < len(self.names)
        return tuple(float(right[part].mean()) if part.any() else 0.0 for part in (is_object, ~is_object))


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of `train-classifier`."""
    parser.add_argument("--detector", type=pathlib.Path, required=True, help="the detector whose boxes are named: an ONNX file of `export`, its card beside it")
    parser.add_argument("--data", type=pathlib.Path, nargs="+", required=True, help="COCO folders to learn from")
    parser.add_argument("--validate", type=pathlib.Path, required=True, help="a COCO folder to validate on")
    parser.add_argument("--out", type=pathlib.Path, required=True, help="checkpoints and log; goes on if there are any")
    parser.add_argument("--epochs", type=int, default=30)
    parser.add_argument("--minutes", type=float, default=0, help="end earlier, after this time; 0: no limit")
    parser.add_argument("--batch", type=int, default=64)
    parser.add_argument("--rate", type=float, default=1e-3, help="peak learning rate")
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--workers", type=int, default=0, help="processes that prepare inputs")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--fresh", action="store_true", help="begin anew although there are checkpoints")
    parser.add_argument("--start-from", type=pathlib.Path, help="a classifier's best.pt to begin with")
    parser.add_argument("--backbone-of", type=pathlib.Path, help="begin with the backbone of this detector of scale lite (ONNX), not with ImageNet's")


def run(options: argparse.Namespace) -> None:
    """Trains."""
    Run(options).train()
