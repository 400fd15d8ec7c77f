"""What the benches share: statistics, programs, tables."""

import json
import math
import os
import pathlib
import platform
import shutil
import subprocess
import sys

ROOT = pathlib.Path(__file__).resolve().parent.parent
CONFIDENCE = 0.95
TOO_FEW = "too few rounds"
# Two-sided 95 % quantiles of Student's t, by degrees of freedom.
STUDENT = [12.71, 4.303, 3.182, 2.776, 2.571, 2.447, 2.365, 2.306, 2.262, 2.228, 2.201, 2.179, 2.160, 2.145, 2.131]
# Means of two renderers may differ by so many standard errors, and by this share besides: what they may round in other ways.
MOST_SIGMAS = 5.0
MOST_SHARE = 0.002


class Failure(Exception):
    """Something that the user can mend. One line."""


def say(message):
    print(message, file=sys.stderr, flush=True)


def median(values):
    ordered = sorted(values)
    middle = len(ordered) // 2
    return ordered[middle] if len(ordered) % 2 else (ordered[middle - 1] + ordered[middle]) / 2


def interval(values):
    """A confidence interval of the median, by order statistics: it asks nothing of how the values are spread.

    The narrowest pair of k-th lowest and k-th highest that holds the median with at least 95 %. Of fewer than 6 values not
    even lowest and highest do, and there is none.
    """
    ordered = sorted(values)
    n = len(ordered)
    if 2 / 2**n > 1 - CONFIDENCE:
        return None, None
    # The median lies outside with the probability of fewer than k heads, or tails, in n throws.
    k, outside = 0, 0.0
    while k < n // 2 and 2 * (outside + math.comb(n, k) / 2**n) <= 1 - CONFIDENCE:
        outside += math.comb(n, k) / 2**n
        k += 1
    return ordered[k - 1], ordered[n - k]


def summary(values):
    low, high = interval(values)
    return {"median": median(values), "low": low, "high": high}


def student(freedom):
    """Half of a 95 % interval, in standard errors."""
    return STUDENT[freedom - 1] if freedom <= len(STUDENT) else 1.96 + 2.4 / freedom


def mean_and_error(values):
    mean = math.fsum(values) / len(values)
    variance = math.fsum((value - mean) ** 2 for value in values) / (len(values) - 1)
    return mean, math.sqrt(variance / len(values))


def mean_interval(values):
    """Mean and half of its 95 % interval."""
    mean, error = mean_and_error(values)
    return {"mean": mean, "half": student(len(values) - 1) * error}


def beside(values, first):
    """Difference of a mean from another one, in parts of that, and half of its 95 % interval."""
    a, b = mean_interval(values), mean_interval(first)
    return {"mean": a["mean"] / b["mean"] - 1, "half": math.hypot(a["half"], b["half"]) / b["mean"]}


def differences(means):
    """How far the images of two programs are apart in the mean, and how far they may be, in shares of the latter's, by
    colour."""
    for channel, colour in enumerate(("red", "green", "blue")):
        (a, a_error), (b, b_error) = (mean_and_error([mean[channel] for mean in m]) for m in means.values())
        scale = abs(b) or 1.0
        allowed = MOST_SIGMAS * math.hypot(a_error, b_error) / scale + MOST_SHARE
        yield {"colour": colour, "share": abs(a - b) / scale, "allowed": allowed}


def complaint(apart):
    """What is wrong with the means, in words, or None."""
    for channel in apart:
        # Also where a number is none.
        if not channel["share"] <= channel["allowed"]:
            return f"the images' {channel['colour']} differs by {channel['share']:.2%}, and {channel['allowed']:.2%} is noise"
    return None


def verdict(ratio, target):
    """Whether a target is met: by the median. What lies in the interval is said to."""
    if target is None:
        return "-"
    if ratio["low"] is None:
        return TOO_FEW
    word = "met" if ratio["median"] >= target else "missed"
    return word if not ratio["low"] < target <= ratio["high"] else f"{word}, within noise"


def with_interval(estimate, show):
    """A median and its interval, or why there is none; `show` makes text of a number."""
    if estimate["low"] is None:
        return f"{show(estimate['median'])}, {TOO_FEW}"
    return f"{show(estimate['median'])} [{show(estimate['low'])}, {show(estimate['high'])}]"


def millions(estimate, digits=2):
    return with_interval(estimate, lambda value: f"{value / 1e6:.{digits}f}")


def ratio_text(ratio):
    return with_interval(ratio, lambda value: f"{value:.2f}")


def table(head, rows):
    lines = [head, ["---"] * len(head), *rows]
    return "".join("| " + " | ".join(line) + " |\n" for line in lines)


def run(command, **options):
    """Runs a program to its end and gives its stdout; what it says on stderr is part of a failure."""
    command = [str(word) for word in command]
    try:
        done = subprocess.run(command, capture_output=True, text=True, check=False, **options)
    except OSError as error:
        raise Failure(f"{command[0]}: cannot be started: {error.strerror}") from error
    if done.returncode != 0:
        code = done.returncode
        ended = f"exit code {code}" if code > 0 else f"ended by signal {-code}"
        said = " ".join(done.stderr.split()) or ended
        raise Failure(f"{pathlib.Path(command[0]).name} {command[1]}: {said[-2000:]}")
    return done.stdout


def build_raywave(given):
    """The program to measure: the one that is named, or a release build of this tree."""
    if given is not None:
        if not given.is_file():
            raise Failure(f"{given}: there is no such program; build it, or leave --raywave out")
        return given.resolve()
    say("building raywave")
    run(["cargo", "build", "--release", "--quiet"], cwd=ROOT)
    return target_folder() / "release" / "raywave"


def target_folder():
    return pathlib.Path(os.environ.get("CARGO_TARGET_DIR", ROOT / "target"))


def render_square(options, scene, flags, samples, seed, folder):
    """Renders a scene, or none for the built-in one, with such flags of render: the image, by the seed's parity, and the
    report. The options have raywave, its device and the size."""
    image, stats = folder / f"{seed % 2}.exr", folder / "stats.json"
    command = [options.raywave, "render", *scene, "-o", image, "--stats", stats, "--quiet", *flags.split()]
    command += ["--width", options.size, "--height", options.size, "--samples", samples, "--seed", seed]
    run(command + (["--device", options.device] if options.device else []))
    return image, json.loads(stats.read_text())


class Worker:
    """A program that stays: it does a round for each line on its stdin and answers with a line of JSON."""

    def __init__(self, command):
        self.name = pathlib.Path(command[0]).name
        self.process = subprocess.Popen(
            [str(word) for word in command], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )
        self.about = self._answer()

    def _answer(self):
        line = self.process.stdout.readline()
        if not line:
            raise Failure(f"{self.name} ended with exit code {self.process.wait()}; its own words are above")
        return json.loads(line)

    def ask(self, line):
        try:
            self.process.stdin.write(line + "\n")
            self.process.stdin.flush()
        except BrokenPipeError:
            pass
        return self._answer()

    def close(self):
        self.process.stdin.close()
        self.process.wait()

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.close()


def check_mitsuba(given, leave_out=""):
    """Fails where Mitsuba or the oracle is missing; `leave_out` says how to do without."""
    if given.oracle is None:
        raise Failure(f"name the script that loads scenes into Mitsuba by --oracle{leave_out}")
    if not given.oracle.is_file():
        raise Failure(f"{given.oracle}: there is no such script")
    try:
        probe = subprocess.run([given.python, "-c", "import mitsuba, numpy"], capture_output=True, check=False)
    except OSError as error:
        raise Failure(f"{given.python}: cannot be started: {error.strerror}") from error
    if probe.returncode != 0:
        raise Failure(
            f"Mitsuba is missing for {given.python}: pip install mitsuba numpy, and on Debian apt-get install libllvm19"
            f"{leave_out}"
        )


class Raywave:
    """`raywave render`, a process each time; the seconds are those that it reports, from a scene that is loaded and kernels
    that are compiled to the last sample. `work` has scene, width, height and bounces; the image of a render is left
    in `image`."""

    name = "raywave"

    def __init__(self, given, program, work, folder, flags=()):
        self.image, self.stats = folder / "image.exr", folder / "stats.json"
        self.command = [program, "render", work.scene, "-o", self.image, "--stats", self.stats, "--quiet"]
        self.command += ["--width", work.width, "--height", work.height, "--max-bounces", work.bounces]
        self.command += [*flags, *(["--device", given.device] if given.device else [])]

    def render(self, samples, seed, *flags):
        run([*self.command, *flags, "--samples", samples, "--seed", seed])
        report = json.loads(self.stats.read_text())
        self.about = report["settings"]
        return {"seconds": report["wall_seconds"], "mean": report["mean_radiance"], "samples": samples}


class Mitsuba:
    """A worker that has loaded the scene."""

    name = "mitsuba"

    def __init__(self, given, work):
        command = [given.python, ROOT / "bench" / "mitsuba_worker.py", given.oracle, work.scene]
        self.worker = Worker([*command, work.width, work.height, work.bounces, given.variant])
        self.about = self.worker.about

    def render(self, samples, seed, *more):
        """The samples are those that the sampler made of what it was asked for."""
        return self.worker.ask(" ".join(str(word) for word in (samples, seed, *more)))


def machine():
    """What a figure depends on."""
    model, flags = platform.processor(), ""
    cpuinfo = pathlib.Path("/proc/cpuinfo")
    if cpuinfo.exists():
        for line in cpuinfo.read_text().splitlines():
            key, _, value = line.partition(":")
            if key.strip() == "model name":
                model = value.strip()
            if key.strip() == "flags":
                flags = value
    wide = [name for name in ("avx2", "avx512f") if name in flags.split()]
    return {
        "cpu": model,
        "vector_instructions": wide,
        "cores": len(os.sched_getaffinity(0)),
        "kernel": platform.release(),
        "python": platform.python_version(),
        "load_average_at_start": os.getloadavg()[0],
    }


def machine_line(about):
    wide = ", ".join(about["vector_instructions"]) or "no wide vectors"
    return f"{about['cpu']} ({wide}), {about['cores']} cores, load {about['load_average_at_start']:.1f} at the start"


def write_text(path, text):
    """Whole or not at all."""
    part = path.with_name(path.name + ".part")
    part.write_text(text, encoding="utf-8")
    part.replace(path)


def write_json(path, report):
    write_text(path, json.dumps(report, indent=2) + "\n")


def check_output(path):
    if path is not None and (path.is_dir() or not path.resolve().parent.is_dir()):
        raise Failure(f"{path}: cannot be written; name a file in a folder that exists")


def need(program, packages):
    if shutil.which(program) is None:
        raise Failure(f"{program} is missing; {packages}")


def scene_file(given, raywave, case, folder):
    """The scene of a case: one of raywave's own, the gallery among them, or one in the folder that --scenes names, as
    CASE.toml or CASE/CASE.toml."""
    if case == "gallery":
        scene = folder / "gallery" / "gallery.toml"
        if not scene.exists():
            say(f"writing the gallery of {given.triangles} triangles")
            run([raywave, "gallery", scene.parent, "--triangles", given.triangles])
        return scene
    own = ROOT / "scenes" / f"{case}.toml"
    if own.is_file():
        return own
    place = given.scenes
    if place is None:
        raise Failure(f"{case} is not part of raywave; name its folder by --scenes")
    for path in (place / f"{case}.toml", place / case / f"{case}.toml"):
        if path.is_file():
            return path
    raise Failure(f"{place}: there is no {case}.toml here, nor {case}/{case}.toml")


def main(program):
    """Runs a bench. Exit codes: 0 done, 1 the programs disagree, 2 bad arguments or something missing."""
    try:
        return program()
    except Failure as failure:
        say(f"error: {failure}")
        return 2
    except KeyboardInterrupt:
        return 130
