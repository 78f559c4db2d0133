"""What every training does alike: what comes first, how far it is, how fast it learns, its time, and files that are never half written."""

import argparse
import ctypes
import math
import os
import pathlib
import time

import torch

# The learning rate rises over this many steps, or over a tenth of a short training.
WARM_UP_STEPS = 150
# The learning rate ends at this share of its peak.
LAST_SHARE = 0.02
# No step takes longer; what does was stopped in between.
LONGEST_STEP_SECONDS = 60


def keep_memory() -> None:
    """Has the C library keep freed memory instead of giving it back: fetching it anew costs a fifth of every step."""
    trim_threshold, most_mappings = -1, -4  # glibc's M_TRIM_THRESHOLD and M_MMAP_MAX
    try:
        library = ctypes.CDLL("libc.so.6")
        library.mallopt(trim_threshold, 2**31 - 1)
        library.mallopt(most_mappings, 0)
    except (OSError, AttributeError):
        pass  # another C library: slower, but the same


def prepare(options: argparse.Namespace) -> None:
    """What comes first: the folder `out`, memory, `threads` and `seed`."""
    options.out.mkdir(parents=True, exist_ok=True)
    keep_memory()
    torch.set_num_threads(options.threads)
    torch.manual_seed(options.seed)


class Schedule:
    """Steps, epochs and seconds of a training, by its options `epochs`, `minutes` (0: no limit) and `rate`."""

    def __init__(self, options: argparse.Namespace):
        self.options = options
        self.epoch, self.step, self.seconds, self.steps_in_all = 0, 0, 0.0, 1
        self.last_end = 0.0

    def progress(self) -> float:
        """0 to 1: by steps, or by time where that is nearer to its end."""
        by_time = self.seconds / 60 / self.options.minutes if self.options.minutes else 0.0
        return min(1.0, max(self.step / max(1, self.steps_in_all), by_time))

    def goes_on(self) -> bool:
        """Is there another epoch?"""
        return self.epoch < self.options.epochs and self.progress() < 1

    def rate(self) -> float:
        """The learning rate of this step: warm-up, then a cosine."""
        rising = min(1, (self.step + 1) / min(WARM_UP_STEPS, self.steps_in_all // 10 + 1))
        falling = LAST_SHARE + (1 - LAST_SHARE) * 0.5 * (1 + math.cos(math.pi * self.progress()))
        return self.options.rate * rising * falling

    def set_rate(self, optimiser: torch.optim.Optimizer) -> None:
        """For each group its share of this step's rate."""
        rate = self.rate()
        for group in optimiser.param_groups:
            group["lr"] = rate * group["share"]

    def begin_epoch(self) -> None:
        """What was before is not part of its steps."""
        self.last_end = time.monotonic()

    def count_step(self) -> None:
        """A step has ended. Waiting for its inputs counts too, but not a pause, between two runs of the program or while it is stopped."""
        self.step += 1
        now = time.monotonic()
        self.seconds += min(now - self.last_end, LONGEST_STEP_SECONDS)
        self.last_end = now

    def state(self) -> dict:
        """What a checkpoint keeps."""
        return {"epoch": self.epoch, "step": self.step, "seconds": self.seconds}

    def take(self, state: dict) -> None:
        """Goes on after a checkpoint."""
        self.epoch, self.step, self.seconds = state["epoch"], state["step"], state["seconds"]


def check_loss(loss: torch.Tensor, step: int) -> None:
    """Ends the program where learning has failed."""
    if not torch.isfinite(loss):
        raise SystemExit(f"the loss is {float(loss)} in step {step}; a smaller --rate helps")


def save(content: dict, path: pathlib.Path) -> None:
    """Writes a checkpoint; never half a file."""
    unfinished = path.with_suffix(".tmp")
    torch.save(content, unfinished)
    os.replace(unfinished, path)
