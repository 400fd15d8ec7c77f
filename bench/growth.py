#!/usr/bin/env python3
"""How the cost of a ray grows with the scene.

For galleries of more and more triangles, dumps the camera's rays, the rays of bounce 2 and the shadow
rays of the first surface, replays each dump through its traversal kernel, and draws rays a second
over triangles, both axes logarithmic, as one HTML page. Beside it stands what does not depend on how
busy the machine is: nodes and triangles a ray, BVH build, device memory.

    bench/growth.py --html growth.html
    bench/growth.py --triangles 5000,100000 --rounds 5 --json growth.json

Needs Python 3.9 or later. Galleries are written to a temporary folder, 60 bytes a triangle; the largest
one needs 400 bytes of memory a triangle.
Exit code 2, with one line, where something is missing or a command fails.
"""

import argparse
import json
import math
import os
import pathlib
import sys
import tempfile
from html import escape

sys.dont_write_bytecode = True
sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))
import common

RAYS = [("camera rays", ["--bounce", "0"]), ("bounce 2", ["--bounce", "2"]), ("shadow rays", ["--bounce", "0", "--rays", "shadow"])]
COLOURS = ["#3366aa", "#c2571a", "#3d8b40"]
# What bounce rays may lose from the smallest to the largest scene.
TARGET = 4.0


def counts(text):
    try:
        numbers = [int(float(word)) for word in text.split(",")]
    except ValueError:
        numbers = []
    if len(numbers) < 2 or any(b <= a for a, b in zip(numbers, numbers[1:])):
        raise argparse.ArgumentTypeError(f"'{text}' is no list of rising counts, as in 5000,100000,1e6")
    return numbers


def about(raywave, scene):
    """What `raywave info` says of the scene that does not depend on rays."""
    told = json.loads(common.run([raywave, "info", scene, "--json"]))
    triangles = told["triangles"]
    return {
        "triangles": triangles,
        "bvh_build_triangles_per_second": triangles / told["bvh_build_seconds"],
        "device_bytes_per_triangle": told["specialized"]["scene_bytes_per_triangle"],
    }


def measure(options, folder, triangles):
    """One row: a gallery, and its rays of each kind."""
    scene = folder / "gallery.toml"
    common.run([options.raywave, "gallery", folder, "--triangles", triangles])
    row = about(options.raywave, scene)
    device = ["--device", options.device] if options.device else []
    row["rays"] = {}
    for name, which in RAYS:
        dump, report = folder / "dump.rays", folder / "replay.json"
        size = ["--width", options.width, "--height", options.width * 9 // 16, "--samples", 1]
        common.run([options.raywave, "dump-rays", scene, *which, *size, *device, "-o", dump, "--quiet"])
        common.run([options.raywave, "replay", scene, dump, "--rounds", options.rounds, *device, "--json", report])
        told = json.loads(report.read_text())
        row["rays"][name] = {key: told[key] for key in ("rays_per_second", "nodes_visited_per_ray", "triangles_tested_per_ray", "hit_share")}
        row["device"], row["driver"] = told["device"], told["driver"]
        common.say(f"{row['triangles']:>9} triangles, {name}: {told['rays_per_second']['median'] / 1e6:.3f} M rays/s")
    return row


def slowdown(rows, name):
    """How much slower the largest scene is than the smallest one."""
    speed = lambda row: row["rays"][name]["rays_per_second"]["median"]
    return speed(rows[0]) / speed(rows[-1])


def plot(rows):
    """Speeds over triangles as SVG, with the interval of each median."""
    left, right, top, bottom, width, height = 70, 830, 16, 360, 960, 410
    speeds = [ray["rays_per_second"] for row in rows for ray in row["rays"].values()]
    # Of too few rounds there is no interval.
    ends = [value for speed in speeds for value in (speed["low"], speed["median"], speed["high"]) if value is not None]
    low, high = math.log10(min(ends)) - 0.05, math.log10(max(ends)) + 0.05
    first, last = math.log10(rows[0]["triangles"]), math.log10(rows[-1]["triangles"])
    x = lambda value: left + (math.log10(value) - first) / (last - first) * (right - left)
    y = lambda value: bottom - (math.log10(value) - low) / (high - low) * (bottom - top)
    ticks = lambda low, high: [m * 10.0**e for e in range(math.floor(low), math.ceil(high) + 1) for m in (1, 2, 5) if low <= math.log10(m * 10.0**e) <= high]
    parts = [f'<svg viewBox="0 0 {width} {height}" role="img" aria-label="rays a second over triangles">']
    for value in ticks(low, high):
        parts.append(f'<line x1="{left}" x2="{right}" y1="{y(value):.1f}" y2="{y(value):.1f}" class="grid"/>'
                     f'<text x="{left - 8}" y="{y(value) + 4:.1f}" text-anchor="end">{value / 1e6:g}</text>')
    for value in ticks(first, last):
        name = f"{value / 1e6:g} M" if value >= 1e6 else f"{value / 1e3:g} k"
        parts.append(f'<line x1="{x(value):.1f}" x2="{x(value):.1f}" y1="{top}" y2="{bottom}" class="grid"/>'
                     f'<text x="{x(value):.1f}" y="{bottom + 18}" text-anchor="middle">{name}</text>')
    parts.append(f'<text x="{(left + right) / 2}" y="{height - 8}" text-anchor="middle">triangles</text>'
                 f'<text transform="translate(16 {(top + bottom) / 2}) rotate(-90)" text-anchor="middle">M rays a second</text>')
    for (name, _), colour in zip(RAYS, COLOURS):
        points = [(x(row["triangles"]), row["rays"][name]["rays_per_second"], row) for row in rows]
        line = " ".join(f"{px:.1f},{y(speed['median']):.1f}" for px, speed, _ in points)
        parts.append(f'<polyline points="{line}" fill="none" stroke="{colour}" stroke-width="2"/>')
        for px, speed, row in points:
            if speed["low"] is not None:
                parts.append(f'<line x1="{px:.1f}" x2="{px:.1f}" y1="{y(speed["low"]):.1f}" y2="{y(speed["high"]):.1f}" stroke="{colour}" stroke-width="4"/>')
            parts.append(f'<circle cx="{px:.1f}" cy="{y(speed["median"]):.1f}" r="4" fill="{colour}"><title>{name}, {row["triangles"]:,} triangles: '
                         f'{common.millions(speed, 3)} M rays/s</title></circle>')
        parts.append(f'<text x="{right + 10}" y="{y(points[-1][1]["median"]) + 4:.1f}" fill="{colour}">{name}</text>')
    return "\n".join(parts + ["</svg>"])


def table(rows):
    """All numbers."""
    head = ["triangles"] + [cell for name, _ in RAYS for cell in (f"{name}, M rays/s", "nodes", "triangles")]
    head += ["build, M triangles/s", "bytes a triangle"]
    parts = ["<table><tr>" + "".join(f"<th>{cell}</th>" for cell in head) + "</tr>"]
    for row in rows:
        cells = [f"{row['triangles']:,}"]
        for name, _ in RAYS:
            ray = row["rays"][name]
            speed = ray["rays_per_second"]
            cells += [common.millions(speed, 3),
                      f"{ray['nodes_visited_per_ray']:.2f}", f"{ray['triangles_tested_per_ray']:.2f}"]
        cells += [f"{row['bvh_build_triangles_per_second'] / 1e6:.2f}", f"{row['device_bytes_per_triangle']:.1f}"]
        parts.append("<tr>" + "".join(f"<td>{cell}</td>" for cell in cells) + "</tr>")
    return "\n".join(parts + ["</table>"])


def page(rows, options):
    losses = ", ".join(f"{name} {slowdown(rows, name):.2f}" for name, _ in RAYS)
    return f"""<!doctype html>
<html lang="en"><head><meta charset="utf-8"><title>Cost of a ray as the scene grows</title><style>
body {{ font: 15px/1.5 system-ui, sans-serif; max-width: 960px; margin: 2em auto; padding: 0 1em; color: #222; background: #fff }}
svg text {{ font: 12px system-ui, sans-serif }} .grid {{ stroke: #ddd }}
table {{ border-collapse: collapse; font-size: 13px; display: block; overflow-x: auto }} th, td {{ padding: 3px 8px; text-align: right; border-bottom: 1px solid #ddd; white-space: nowrap }}
</style></head><body>
<h1>Cost of a ray as the scene grows</h1>
<p>{escape(rows[0]["device"])}, {escape(rows[0]["driver"])}. Galleries (<code>raywave gallery</code>), {options.width}x{options.width * 9 // 16} pixels, one sample; each dump replayed in {options.rounds} rounds. Medians, with 95 % intervals as bars.</p>
<p>From {rows[0]["triangles"]:,} to {rows[-1]["triangles"]:,} triangles rays become slower by these factors: {losses}. The aim for bounce rays is at most {TARGET:g} over four decades.</p>
{plot(rows)}
{table(rows)}
</body></html>
"""


def program():
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("--raywave", type=pathlib.Path, help="the program to measure; without, a release build of this tree")
    parser.add_argument("--triangles", type=counts, default=counts("5000,20000,100000,500000,2e6,1e7"), help="counts, rising (5000 to 1e7)")
    parser.add_argument("--width", type=int, default=640, help="pixels; the height is 9/16 of it (640)")
    parser.add_argument("--rounds", type=int, default=12, help="timed rounds of each dump (12)")
    parser.add_argument("--device", default=os.environ.get("RAYWAVE_DEVICE"), help="as for raywave")
    parser.add_argument("--folder", help="where galleries are written, one after the other (a temporary folder)")
    parser.add_argument("--html", type=pathlib.Path, help="page to write")
    parser.add_argument("--json", type=pathlib.Path, help="file for all numbers")
    options = parser.parse_args()
    common.check_output(options.html)
    common.check_output(options.json)
    options.raywave = common.build_raywave(options.raywave)
    rows = []
    with tempfile.TemporaryDirectory(dir=options.folder) as folder:
        for triangles in options.triangles:
            rows.append(measure(options, pathlib.Path(folder), triangles))
            # What is done is kept, should a larger scene fail.
            if options.json:
                common.write_json(options.json, rows)
            if options.html and len(rows) > 1:
                common.write_text(options.html, page(rows, options))
    for name, _ in RAYS:
        loss = slowdown(rows, name)
        verdict = "" if name != "bounce 2" else f" (aim: at most {TARGET:g})"
        print(f"{name}: {loss:.2f} times slower from {rows[0]['triangles']:,} to {rows[-1]['triangles']:,} triangles{verdict}")
    return 0


if __name__ == "__main__":
    sys.exit(common.main(program))
