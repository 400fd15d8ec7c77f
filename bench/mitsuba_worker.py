"""Renders with Mitsuba 3 on command: the peer of `bench/samples` and `bench/vs_mitsuba`, which drive it.

    mitsuba_worker.py ORACLE SCENE WIDTH HEIGHT MAX_BOUNCES VARIANT

ORACLE is a script that reads raywave's scenes for Mitsuba: `define_bsdfs(mi, dr)` registers what materials need, and
`build(mi, dr, path, size=, bounces=, sampler=, rr=)` gives a scene with Mitsuba's `path` integrator, and its width and
height; by default with independent samples and without roulette, which `rr` has begin at a depth. It is used as a module.

Each line on stdin is a request, and the answer is a line of JSON:

    SAMPLES SEED [SAMPLER ROULETTE_DEPTH FILE]
        A render: seconds of it alone, mean radiance, and the samples of a pixel, which some samplers round up. FILE gets the
        image: red, green and blue of each pixel as 32-bit floats, row by row.
    convert EXR FILE
        The same file of an image.
"""

import importlib.util
import json
import pathlib
import sys
import time


def main():
    oracle_path, scene_path, width, height, bounces, variant = sys.argv[1:]
    # The oracle may know where LLVM lies, and says so to Dr.Jit before that is loaded.
    specification = importlib.util.spec_from_file_location("oracle", oracle_path)
    oracle = importlib.util.module_from_spec(specification)
    specification.loader.exec_module(oracle)
    import drjit as dr
    import mitsuba as mi
    import numpy as np

    # Stdout is for answers; Mitsuba may log there, and warns of every rounded count.
    answers, sys.stdout = sys.stdout, sys.stderr
    mi.set_variant(variant)
    mi.set_log_level(mi.LogLevel.Error)
    oracle.define_bsdfs(mi, dr)
    size = (int(width), int(height))
    scenes = {}

    def scene_with(**settings):
        key = tuple(settings.items())
        if key not in scenes:
            scenes[key], *_ = oracle.build(mi, dr, pathlib.Path(scene_path), size=size, bounces=int(bounces), **settings)
        return scenes[key]

    def answer(**told):
        print(json.dumps(told), file=answers, flush=True)

    def write(image, file):
        np.ascontiguousarray(image[..., :3], dtype=np.float32).tofile(file)

    def render(samples, seed, sampler=None, roulette=None, file=None):
        scene = scene_with(sampler=sampler, rr=int(roulette)) if sampler else scene_with()
        start = time.perf_counter()
        # The copy to NumPy waits for the render.
        image = np.array(mi.render(scene, spp=int(samples), seed=int(seed)))
        seconds = time.perf_counter() - start
        if file:
            write(image, file)
        mean = image[..., :3].astype(np.float64).mean(axis=(0, 1))
        answer(seconds=seconds, mean=mean.tolist(), samples=scene.sensors()[0].sampler().sample_count())

    integrator = mi.traverse(scene_with().integrator())
    about = {"mitsuba": mi.__version__, "drjit": dr.__version__, "variant": variant, "python": sys.version.split()[0]}
    answer(**about, size=size, integrator=str(integrator))
    for line in sys.stdin:
        first, *rest = line.split()
        if first == "convert":
            exr, file = rest
            write(np.array(mi.Bitmap(exr)), file)
            answer()
        else:
            render(first, *rest)


main()
