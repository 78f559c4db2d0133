"""`python -m nearfield_training toy|train|export|cut|calibration-set|cross-check|goldens ...`"""

import argparse
import importlib

VERBS = {
    "toy": ("toy", "make a small dataset of drawn shapes"),
    "train": ("train", "train a network on COCO folders; goes on where it was stopped"),
    "export": ("export", "write ONNX, int8, the card, and what Hailo's compiler needs"),
    "cut": ("cut", "renew in a card where the host's default backend cuts the network"),
    "calibration-set": ("calibration_set", "write inputs for the quantisation by Hailo's compiler"),
    "cross-check": ("cross_check", "hold `nearfield evaluate` against pycocotools"),
    "goldens": ("goldens", "write what onnxruntime makes of pictures, for the host's tests"),
}


def main() -> None:
    """Reads the command line."""
    parser = argparse.ArgumentParser(prog="nearfield_training", description="Training of the detector.")
    verbs = parser.add_subparsers(dest="verb", required=True)
    modules = {}
    for verb, (module, text) in VERBS.items():
        modules[verb] = importlib.import_module(f".{module}", __package__)
        modules[verb].add_arguments(verbs.add_parser(verb, help=text, description=text))
    options = parser.parse_args()
    modules[options.verb].run(options)


if __name__ == "__main__":
    main()
