"""Builds the wheel of `desk/python/` from the command that the tests have built, installs it, and calls its module.

    wheel.py TARGET FOLDER FILE STOPPING

TARGET is cargo's folder, FOLDER gets the wheel and a fresh environment. FILE is a job, STOPPING one that stops at a line. Prints one
JSON object.
"""

import json
import os
import pathlib
import subprocess
import sys

SOURCES = pathlib.Path(__file__).resolve().parents[2] / "desk/python"

# Executed by the fresh environment, whose only package is the wheel.
USE = """
import json
import sys

import ferrostep

file, stopping, page = sys.argv[1:4]
estimate = ferrostep.estimate(file, profile="corexy")
comparison = ferrostep.compare(file, profile="corexy", settings={"junction_deviation_mm": 0.05})
shown = ferrostep.show(file, page, profile="corexy")
seen = {
    "command": str(ferrostep.command()),
    "report": dict(estimate.report),
    "time_s": [estimate.print_time_s, comparison.a.print_time_s, comparison.b.print_time_s],
    "remarks": [remark.message for remark in estimate.remarks],
    "page": [str(shown.path), shown.summary],
}
try:
    ferrostep.estimate(stopping)
except ferrostep.JobStopped as stop:
    seen["stopped"] = [stop.line, str(stop)]
try:
    ferrostep.estimate("no-such-file.gcode")
except ferrostep.CannotStart as refusal:
    seen["refused"] = str(refusal)
try:
    ferrostep.estimate(file, profile="corexi")
except ferrostep.FerrostepError as refusal:
    seen["profile"] = [type(refusal).__name__, str(refusal)]
print(json.dumps(seen))
"""


def main():
    target, folder, file, stopping = sys.argv[1:5]
    folder = pathlib.Path(folder)
    # `linux`: the command of the tests is linked with this computer's C library, which a released
    # wheel must not be.
    build = ["build", "--profile", "dev", "--compatibility", "linux", "--target-dir", target, "--out", str(folder)]
    subprocess.run([sys.executable, "-m", "maturin", *build], cwd=SOURCES, check=True, stdout=sys.stderr)
    (wheel,) = folder.glob("*.whl")
    environment = folder / "environment"
    subprocess.run([sys.executable, "-m", "venv", str(environment)], check=True)
    python = environment / "bin/python"
    pip = [str(python), "-m", "pip", "install", "--quiet", "--disable-pip-version-check", "--no-index"]
    subprocess.run([*pip, str(wheel)], check=True)
    # Nothing of the surroundings: no path on which the tests' own command could be found.
    surroundings = {**os.environ, "PATH": "/usr/bin:/bin"}
    words = [str(python), "-I", "-c", USE, file, stopping, str(folder / "page.html")]
    said = subprocess.run(words, check=True, capture_output=True, text=True, env=surroundings).stdout
    print(json.dumps({"wheel": wheel.name, **json.loads(said)}))


main()
