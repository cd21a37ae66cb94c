"""What the benchmark scripts share: scenes, runs of the program with their time and report, references."""
import json
import os
import pathlib
import platform
import shutil
import statistics
import subprocess
import sys
import time

ROOT = pathlib.Path(__file__).resolve().parents[2]

# file below scenes/, camera, frame, width : height, --mask-above: pixels that show a lamp would set the peak of PSNR.
# Lights are those of the file: Sponza has its sun.
SCENES = {
    "cornell": ("exact/cornell.glb", "camera", 1, (1, 1), 1.0),
    "gallery": ("exact/gallery.glb", "still", 1, (16, 9), 3.0),
    "sponza": ("sponza-dabrovic/sponza-sun-flythrough.glb", "ground floor", 1, (16, 9), 0.0),
    "pandora": ("pandora/pandora.glb", "interior 1", 1, (16, 9), 3.0),
}
REFERENCE_SEED = 1000003  # its noise is independent of the images'


def add_arguments(parser):
    data = os.environ.get("KEEPLIGHT_DATA", str(ROOT.parent / "shared"))
    parser.add_argument("--quick", action="store_true", help="small images, fewer samples: minutes on two cores")
    parser.add_argument("--scenes", default=",".join(SCENES), help="default: %(default)s")
    parser.add_argument("--data", default=data, help="folder with scenes/ (default: KEEPLIGHT_DATA or ../shared)")
    parser.add_argument("--keeplight", default=str(ROOT / "build/release/keeplight"), help="the program")
    parser.add_argument("--threads", type=int, default=os.cpu_count(), help="default: %(default)s")


class Shot:
    """A scene, seen by a camera in one size."""

    def __init__(self, name, arguments, out, height):
        file, self.camera, self.frame, (w, h), self.lamp = SCENES[name]
        self.name = name
        self.file = pathlib.Path(arguments.data) / "scenes" / file
        self.width, self.height = height * w // h, height
        self.keeplight = arguments.keeplight
        self.threads = arguments.threads
        self.out = pathlib.Path(out)
        self.out.mkdir(parents=True, exist_ok=True)

    def render(self, image, *options, layers="none"):
        """One frame, never skipped. Its report, with `process`: seconds on the clock and of the processors."""
        report = self.out / (image + ".json")
        (self.out / (image + ".exr")).unlink(missing_ok=True)
        command = [self.keeplight, "render", str(self.file), "--camera", self.camera, "--frames", str(self.frame),
                   "--size", "%dx%d" % (self.width, self.height), "--aov", layers, "--device", "embree",
                   "--threads", str(self.threads), "--progress", "off", "--overwrite",
                   "--out", str(self.out / (image + ".exr")), "--report", str(report), *map(str, options)]
        start, before = time.monotonic(), os.times()
        done = subprocess.run(command, stdout=subprocess.DEVNULL)
        if done.returncode != 0 and not ("--verify" in command and done.returncode == 5):  # 5: measured, and too large
            sys.exit("%s: exit code %d" % (" ".join(command), done.returncode))
        after = os.times()
        result = json.loads(report.read_text())
        result["process"] = {
            "seconds": time.monotonic() - start,
            "cpu_seconds": after.children_user + after.children_system - before.children_user - before.children_system,
        }
        return result

    def compare(self, image, reference, *options):
        command = [self.keeplight, "compare", str(self.out / (image + ".exr")), str(reference),
                   "--mask-above", str(self.lamp), *options, "--json"]
        return json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout)

    def reference(self, folder, spp, layers="none"):
        """Path traced once and kept in `folder`; its name says what it is of. None of its time counts."""
        folder = pathlib.Path(folder)
        folder.mkdir(parents=True, exist_ok=True)
        name = "%s-%dx%d-%d%s.exr" % (self.name, self.width, self.height, spp, "" if layers == "none" else "-" + layers)
        kept = folder / name
        if not kept.exists():
            say("%s: reference of %d samples" % (self.name, spp))
            self.render("reference", "--indirect", "path", "--spp", spp, "--seed", REFERENCE_SEED, layers=layers)
            shutil.move(self.out / "reference.exr", kept)
        return kept


def seconds_of(report):
    """Of the frame: fill and shading, without loading the scene and writing the image."""
    seconds = report["frames"][0]["seconds"]
    return seconds["total"] - seconds["write"]


def median_run(run, repeat):
    """The report whose time is the median of `repeat` runs."""
    reports = sorted((run() for _ in range(repeat)), key=seconds_of)
    median = reports[len(reports) // 2]
    times = [seconds_of(r) for r in reports]
    median["process"]["spread"] = (times[-1] - times[0]) / statistics.median(times)
    return median


def machine(arguments):
    model = "unknown"
    for line in pathlib.Path("/proc/cpuinfo").read_text().splitlines():
        if line.startswith("model name"):
            model = line.split(":", 1)[1].strip()
            break
    version = subprocess.run([arguments.keeplight, "--version"], check=True, capture_output=True, text=True)
    return {"processor": model, "cores": os.cpu_count(), "threads": arguments.threads, "system": platform.platform(),
            "program": version.stdout.strip()}


def chosen_scenes(arguments):
    names = arguments.scenes.split(",")
    for name in names:
        if name not in SCENES:
            sys.exit("no scene '%s'; there are %s" % (name, ", ".join(SCENES)))
        path = pathlib.Path(arguments.data) / "scenes" / SCENES[name][0]
        if not path.exists():
            sys.exit("no scene file %s (--data, KEEPLIGHT_DATA)" % path)
    return names


def say(text):
    print(text, file=sys.stderr, flush=True)


def gnuplot(script, what):
    """False where there is no gnuplot, which is said."""
    if shutil.which("gnuplot") is None:
        say("%s: gnuplot is not installed (Debian: gnuplot-nox)" % what)
        return False
    subprocess.run(["gnuplot"], input=script, text=True, check=True)
    return True
