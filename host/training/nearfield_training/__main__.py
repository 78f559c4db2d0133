"""`python -m nearfield_training toy|train|export|train-classifier|export-classifier|cut|calibration-set|...`"""

import argparse
import importlib

VERBS = {
    "toy": ("toy", "make a small dataset of drawn shapes"),
    "train": ("train", "train a network on COCO folders; goes on where it was stopped"),
    "export": ("export", "write ONNX, int8, the card, and what Hailo's compiler needs"),
    "train-classifier": ("classifier", "train the network that names what a detector found"),
    "export-classifier": ("export_classifier", "write the classifier beside its detector"),
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
