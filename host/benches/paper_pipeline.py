"""The source paper's first method in OpenCV, timed on one thread: the reference of `cargo xtask bench`.

Usage: paper_pipeline.py PICTURE.png RIG.toml

Protocol: prints `ready` and OpenCV's version; then, for every line on standard input, runs the pipeline once and prints
its time in milliseconds. Steps, in the paper's order: HSV, adaptive thresholds of hue and saturation, morphology, Hough
lines, warp of the region of interest to a view from above, running average over 5 mm, mean over three frames, longest
gap. Decoding the picture is not timed.
"""

import sys
import time
import tomllib

import cv2
import numpy as np

PIXELS_PER_MM = 2.0
ROI_MM = 60.0
AVERAGE_MM = 5.0
FRAMES = 3
HUE_REACH = 8  # of OpenCV's 180 steps
GAP_MM = 5.0


def floor_homography(rig):
    """From floor points (along, across the stripe, millimetres) to pixels; no lens distortion, as in the paper."""
    camera = rig["camera"]
    rotation, translation = np.array(camera["rotation"]), np.array(camera["translation_mm"])
    matrix = np.array([[camera["fx"], 0, camera["cx"]], [0, camera["fy"], camera["cy"]], [0, 0, 1]])
    along = np.array(rig["stripe"]["direction"])
    across = np.array([-along[1], along[0], 0.0])
    origin = np.array(rig["stripe"]["point_mm"])
    return matrix @ np.column_stack([rotation @ along, rotation @ across, rotation @ origin + translation])


class Pipeline:
    def __init__(self, picture, rig):
        self.picture = picture
        start, end = rig["stripe"]["start_mm"], rig["stripe"]["end_mm"]
        self.size = (int((end - start) * PIXELS_PER_MM), int(2 * ROI_MM * PIXELS_PER_MM))
        view = np.array([[1 / PIXELS_PER_MM, 0, start], [0, 1 / PIXELS_PER_MM, -ROI_MM], [0, 0, 1]])
        self.warp = floor_homography(rig) @ view
        self.block = max(3, picture.shape[1] // 20 | 1)
        self.kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (3, 3))
        self.history = []

    def mask(self):
        hue, saturation, _ = cv2.split(cv2.cvtColor(self.picture, cv2.COLOR_BGR2HSV))
        distance = cv2.min(hue, 180 - hue)
        red = cv2.threshold(distance, HUE_REACH, 255, cv2.THRESH_BINARY_INV)[1]
        redness = np.uint8(90) - distance
        adaptive = [
            cv2.adaptiveThreshold(plane, 255, cv2.ADAPTIVE_THRESH_MEAN_C, cv2.THRESH_BINARY, self.block, -10)
            for plane in (redness, saturation)
        ]
        mask = cv2.bitwise_and(red, cv2.bitwise_and(*adaptive))
        mask = cv2.morphologyEx(mask, cv2.MORPH_OPEN, self.kernel)
        return cv2.morphologyEx(mask, cv2.MORPH_CLOSE, self.kernel)

    def run(self):
        mask = self.mask()
        lines = cv2.HoughLinesP(mask, 1, np.pi / 180, 100, minLineLength=60, maxLineGap=20)
        above = cv2.warpPerspective(mask, self.warp, self.size, flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP)
        middle = above.shape[0] // 2
        band = above[middle - int(5 * PIXELS_PER_MM) : middle + int(5 * PIXELS_PER_MM)]
        length = int(AVERAGE_MM * PIXELS_PER_MM)
        signal = cv2.blur((band.max(axis=0) > 0).astype(np.float32).reshape(1, -1), (length, 1)).ravel()
        self.history = (self.history + [signal])[-FRAMES:]
        dark = np.concatenate([[0], (np.mean(self.history, axis=0) < 0.5).astype(np.int8), [0]])
        steps = np.diff(dark)
        gaps = (np.flatnonzero(steps == -1) - np.flatnonzero(steps == 1)) / PIXELS_PER_MM
        return lines is not None, bool(gaps.size and gaps.max() > GAP_MM)


def main():
    cv2.setNumThreads(1)
    with open(sys.argv[2], "rb") as file:
        rig = tomllib.load(file)
    picture = cv2.imread(sys.argv[1], cv2.IMREAD_COLOR)
    if picture is None:
        sys.exit(f"{sys.argv[1]}: cannot be read as a picture")
    pipeline = Pipeline(picture, rig)
    pipeline.run()
    print("ready", cv2.__version__, flush=True)
    for _ in sys.stdin:
        started = time.perf_counter()
        pipeline.run()
        print(f"{1000 * (time.perf_counter() - started):.4f}", flush=True)


if __name__ == "__main__":
    main()
