"""Renders with Mitsuba 3 on command: the peer of `bench/samples`, which drives it.

    mitsuba_worker.py ORACLE SCENE WIDTH HEIGHT MAX_BOUNCES VARIANT

ORACLE is a script that reads raywave's scenes for Mitsuba: `define_bsdfs(mi, dr)` registers what materials need, and
`build(mi, dr, path, size=, sampler=, bounces=)` gives a scene with Mitsuba's `path` integrator, without roulette, and its
width and height. It is used as a module. Each line on stdin is a render, `SAMPLES SEED`; the answer is a line of JSON:
seconds of the render alone, and the mean radiance of the image.
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

    # Stdout is for answers; Mitsuba may log there.
    answers, sys.stdout = sys.stdout, sys.stderr
    mi.set_variant(variant)
    oracle.define_bsdfs(mi, dr)
    size = (int(width), int(height))
    scene, width, height = oracle.build(mi, dr, pathlib.Path(scene_path), size=size, bounces=int(bounces))
    integrator = mi.traverse(scene.integrator())
    about = {"mitsuba": mi.__version__, "drjit": dr.__version__, "variant": variant, "python": sys.version.split()[0]}
    print(json.dumps(about | {"size": [width, height], "integrator": str(integrator)}), file=answers, flush=True)
    for line in sys.stdin:
        samples, seed = map(int, line.split())
        start = time.perf_counter()
        # The copy to NumPy waits for the render.
        image = np.array(mi.render(scene, spp=samples, seed=seed))
        seconds = time.perf_counter() - start
        mean = image[..., :3].astype(np.float64).mean(axis=(0, 1))
        print(json.dumps({"seconds": seconds, "mean": mean.tolist()}), file=answers, flush=True)


main()
