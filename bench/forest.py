#!/usr/bin/env python3
"""Writes a forest: a tree of any number of triangles that a glTF file places any number of times.

FOLDER/forest.gltf has a tree of leaves about a trunk, --triangles of them or a few less, placed --places times on a plane by
EXT_mesh_gpu_instancing, each turned and scaled at random, and a sun. Nothing but the number of places tells how large the
file is: flattened, 100,000 places of 100,000 triangles would be ten thousand million.
"""

import argparse
import array
import json
import math
import pathlib
import random
import sys

FLOAT, UNSIGNED = 5126, 5125


def arguments():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=pathlib.Path, metavar="FOLDER", help="where the files are written")
    parser.add_argument("--triangles", type=int, default=100_000, help="of the tree (default: %(default)s)")
    parser.add_argument("--places", type=int, default=100_000, help="of the tree (default: %(default)s)")
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    if options.triangles < 64 or options.places < 1:
        parser.error("a forest has a tree of 64 triangles at least; ask for more")
    return options


def trunk(positions, normals, indices):
    sides, height, radius = 12, 0.5, 0.04
    for row in (0, 1):
        for side in range(sides):
            angle = math.tau * side / sides
            x, z = math.cos(angle), math.sin(angle)
            positions.extend((radius * x, row * height, radius * z))
            normals.extend((x, 0.0, z))
    for side in range(sides):
        a, b = side, (side + 1) % sides
        indices.extend((a, a + sides, b, b, a + sides, b + sides))


def leaves(count, chance, positions, normals, indices):
    """Leaves of two triangles each, in the crown of an oak."""
    for _ in range(count):
        while True:
            x, y, z = (chance.uniform(-1.0, 1.0) for _ in range(3))
            radius = math.sqrt(x * x + y * y + z * z)
            if 0.5 < radius < 0.75 + 0.25 * math.sin(7.0 * x) * math.sin(6.0 * y) * math.sin(5.0 * z):
                break
        centre = (0.35 * x, 0.68 + 0.32 * y, 0.35 * z)
        along = [chance.gauss(0.0, 1.0) for _ in range(3)]
        across = [chance.gauss(0.0, 1.0) for _ in range(3)]
        size = 0.008 + 0.006 * chance.random()
        length = math.sqrt(sum(c * c for c in along))
        width = math.sqrt(sum(c * c for c in across))
        along = [size * c / length for c in along]
        across = [0.5 * size * c / width for c in across]
        first = len(positions) // 3
        for corner in ((-1.0, 0.0), (0.0, -1.0), (1.0, 0.0), (0.0, 1.0)):
            positions.extend(centre[i] + corner[0] * along[i] + corner[1] * across[i] for i in range(3))
            normals.extend((x / radius, y / radius, z / radius))
        indices.extend((first, first + 1, first + 2, first, first + 2, first + 3))


def places(count, chance):
    """Translations, rotations and scales of trees on a square, dense in the middle of it."""
    side = 0.75 * math.sqrt(count)
    translations, rotations, scales = array.array("f"), array.array("f"), array.array("f")
    for _ in range(count):
        translations.extend((side * chance.uniform(-0.5, 0.5), 0.0, side * chance.uniform(-0.5, 0.5)))
        angle = math.pi * chance.random()
        rotations.extend((0.0, math.sin(angle), 0.0, math.cos(angle)))
        scale = chance.uniform(0.6, 1.4)
        scales.extend((scale, scale * chance.uniform(0.8, 1.3), scale))
    return side, translations, rotations, scales


def main():
    options = arguments()
    chance = random.Random(options.seed)
    crown = [array.array("f"), array.array("f"), array.array("I")]
    leaves((options.triangles - 24) // 2, chance, *crown)
    stem = [array.array("f"), array.array("f"), array.array("I")]
    trunk(*stem)
    side, *spots = places(options.places, chance)
    half = 0.5 * side + 2.0
    ground = [
        array.array("f", [-half, 0.0, -half, -half, 0.0, half, half, 0.0, half, half, 0.0, -half]),
        array.array("f", [0.0, 1.0, 0.0] * 4),
        array.array("I", [0, 1, 2, 0, 2, 3]),
    ]

    blob, views, accessors = bytearray(), [], []

    def accessor(numbers, kind, component):
        width = {"SCALAR": 1, "VEC3": 3, "VEC4": 4}[kind]
        views.append({"buffer": 0, "byteOffset": len(blob), "byteLength": 4 * len(numbers)})
        blob.extend(numbers.tobytes() if sys.byteorder == "little" else numbers.byteswap().tobytes())
        entry = {"bufferView": len(views) - 1, "componentType": component, "count": len(numbers) // width, "type": kind}
        if component == FLOAT and width == 3:
            entry["min"] = [min(numbers[i::3]) for i in range(3)]
            entry["max"] = [max(numbers[i::3]) for i in range(3)]
        accessors.append(entry)
        return len(accessors) - 1

    def primitive(mesh, material):
        positions, normals, indices = mesh
        attributes = {"POSITION": accessor(positions, "VEC3", FLOAT), "NORMAL": accessor(normals, "VEC3", FLOAT)}
        return {"attributes": attributes, "indices": accessor(indices, "SCALAR", UNSIGNED), "material": material}

    def paint(name, colour):
        surface = {"baseColorFactor": [*colour, 1.0], "metallicFactor": 0.0, "roughnessFactor": 0.9}
        return {"name": name, "pbrMetallicRoughness": surface, "doubleSided": True}

    meshes = [
        {"name": "tree", "primitives": [primitive(crown, 0), primitive(stem, 1)]},
        {"name": "ground", "primitives": [primitive(ground, 2)]},
    ]
    attributes = dict(zip(("TRANSLATION", "ROTATION", "SCALE"), (
        accessor(spots[0], "VEC3", FLOAT), accessor(spots[1], "VEC4", FLOAT), accessor(spots[2], "VEC3", FLOAT))))
    # Over the edge of the forest, towards its middle.
    down, eye = math.radians(-12.0), [0.0, 3.5, 0.5 * side + 2.0]
    sun = {"type": "directional", "color": [1.0, 0.92, 0.8], "intensity": 4.0}
    nodes = [
        {"name": "trees", "mesh": 0, "extensions": {"EXT_mesh_gpu_instancing": {"attributes": attributes}}},
        {"name": "ground", "mesh": 1},
        {"name": "camera", "camera": 0, "translation": eye, "rotation": [math.sin(down / 2), 0.0, 0.0, math.cos(down / 2)]},
        {"name": "sun", "rotation": [-0.35, 0.35, 0.1, 0.86], "extensions": {"KHR_lights_punctual": {"light": 0}}},
    ]
    document = {
        "asset": {"version": "2.0", "generator": "raywave's bench/forest.py"},
        "extensionsUsed": ["EXT_mesh_gpu_instancing", "KHR_lights_punctual"],
        "extensionsRequired": ["EXT_mesh_gpu_instancing"],
        "extensions": {"KHR_lights_punctual": {"lights": [sun]}},
        "scene": 0,
        "scenes": [{"nodes": list(range(len(nodes)))}],
        "nodes": nodes,
        "meshes": meshes,
        "materials": [paint("leaves", (0.10, 0.22, 0.05)), paint("bark", (0.2, 0.12, 0.07)), paint("grass", (0.16, 0.2, 0.08))],
        "cameras": [{"type": "perspective", "perspective": {"yfov": math.radians(45.0), "znear": 0.1}}],
        "accessors": accessors,
        "bufferViews": views,
        "buffers": [{"uri": "forest.bin", "byteLength": len(blob)}],
    }
    options.folder.mkdir(parents=True, exist_ok=True)
    (options.folder / "forest.bin").write_bytes(blob)
    (options.folder / "forest.gltf").write_text(json.dumps(document))
    count = sum(len(mesh[2]) for mesh in (crown, stem)) // 3
    print(f"{options.folder / 'forest.gltf'}: {options.places:,} trees of {count:,} triangles")


if __name__ == "__main__":
    main()
