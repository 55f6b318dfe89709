#!/usr/bin/env python3
"""Prints the figures that the project is held to as one table, from build/bench/*.json of tools/bench.

A figure whose benchmark was not run (a filter was given) has a dash.
"""

import json
import pathlib
import sys

# What, benchmark (its name without /iterations and the like), counter, unit, bound.
FIGURES = [
    ("decode 44 frames of 2048², mono8, per reading them once", "decode_mono8/side_px:2048/cameras:1", "decode_per_read", "×", "≤ 2"),
    ("    frames decoded, a second", "decode_mono8/side_px:2048/cameras:1", "decode_GB_s", "GB/s", ""),
    ("    frames read once, a second", "decode_mono8/side_px:2048/cameras:1", "read_GB_s", "GB/s", ""),
    ("the same of four cameras in turn", "decode_mono8/side_px:2048/cameras:4", "decode_per_read", "×", ""),
    ("the same, mono16", "decode_mono16/side_px:2048/cameras:1", "decode_per_read", "×", "≤ 2"),
    ("    frames decoded, a second", "decode_mono16/side_px:2048/cameras:1", "decode_GB_s", "GB/s", ""),
    ("    frames read once, a second", "decode_mono16/side_px:2048/cameras:1", "read_GB_s", "GB/s", ""),
    ("OpenCV's getProjPixel per decode, mono8", "decode_opencv", "opencv_per_decode", "×", ""),
    ("hand-over, a capture of 11 frames of 64²", "hand_over/64", "cpu_us_per_capture", "µs", ""),
    ("hand-over, a capture of 11 frames of 2048²", "hand_over/2048", "cpu_us_per_capture", "µs", ""),
    ("rays traced, mesh of 1.2 M triangles", "trace/mesh", "rays/s", "/s", ""),
    ("votes, level 7 everywhere", "vote_uniform/7", "hypotheses/s", "/s", ""),
    ("votes, band of level 9", "vote_band/9", "hypotheses/s", "/s", ""),
]


def find(runs, name, counter):
    for run in runs:
        if run["name"] == name or run["name"].startswith(name + "/"):
            return run.get(counter)
    return None


def text(value):
    if value is None:
        return "–"
    for limit, suffix in ((1e6, " M"), (1e4, " k")):
        if value >= limit:
            return f"{value / (1e6 if suffix == ' M' else 1e3):.3g}{suffix}"
    return f"{value:.3g}" if value < 100 else f"{value:.0f}"


def main():
    runs = []
    for path in sys.argv[1:]:
        runs += json.loads(pathlib.Path(path).read_text())["benchmarks"]
    rows = [("figure", "value", "bound")]
    for what, name, counter, unit, bound in FIGURES:
        value = text(find(runs, name, counter))
        rows.append((what, value if value == "–" else f"{value} {unit}".replace(" /s", "/s"), bound))
    widths = [max(len(row[i]) for row in rows) for i in range(3)]
    for row in rows:
        print("  ".join(cell.ljust(width) for cell, width in zip(row, widths)).rstrip())


if __name__ == "__main__":
    main()
